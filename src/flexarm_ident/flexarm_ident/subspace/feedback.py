"""Test for feedback from outputs to inputs.

The innovation is the part of an output that its past does not predict. Without feedback it is
uncorrelated with later inputs. The test takes its correlation with the unpredicted part of these
inputs, all from the block Gram: its first rows are the past, the others the innovation and the
inputs that follow.

Friction biases the test: a linear model leaves a remainder that looks like innovation but recurs
with the input. The correlation must therefore also exceed the correlations at distant lags, at
which no controller answers. An input without low frequencies, such as noise from 20 Hz up, has a
longer memory than the past in the Gram and can pass for feedback.
Haugh, "Checking the independence of two covariance-stationary time series", JASA 71 (1976);
Gustavsson, Ljung, Soderstrom, "Identification of processes in closed loop", Automatica 13 (1977).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

# One false alarm in a million records.
SIGNIFICANCE = 1e-6
_STANDS_OUT = 1.5
# A remainder below this part of a signal's RMS is rounding.
SMALLEST_REMAINDER = 1e-5
_DEPENDENT = 1e-9
# Samples for the background at distant lags.
BACKGROUND_SAMPLES = 2**14


@dataclass(frozen=True)
class FeedbackTest:
    """Outcome of the test.

    Attributes
    ----------
    statistic : float
        Sum of squared canonical correlations times the samples.
    degrees : int
        Degrees of freedom of its chi-square distribution without feedback, which is its mean. 0 for
        data without noise.
    p_value : float
        Probability of a statistic as large without feedback.
    background : float
        Largest statistic at distant lags, scaled to the same samples; 0 when the p-value is large
        enough already.
    detected : bool
        Whether there is feedback.
    """

    statistic: float
    degrees: int
    p_value: float
    background: float
    detected: bool


class Correlation(NamedTuple):
    """Correlation of the innovation with later inputs, as in `FeedbackTest`."""

    statistic: float
    degrees: int
    p_value: float


class _Layout(NamedTuple):
    past: list[int]
    innovation: list[int]
    following: list[int]


class _Whitened(NamedTuple):
    layout: _Layout
    scale: FloatArray
    predictor: FloatArray
    white_e: FloatArray
    white_u: FloatArray
    samples: int
    correlation: Correlation


def reaches_inputs(gram: BlockGram) -> bool:
    """Return whether later inputs are significantly correlated with the innovation.

    The cause may be feedback or friction. Inputs of the same sample are left out, so the result
    does not depend on feedthrough. The rate of false alarms is one in a million records.
    """
    return _whitened(gram, feedthrough=True).correlation.p_value <= SIGNIFICANCE


def feedback_test(
    records: Sequence[IoData], gram: BlockGram, *, feedthrough: bool = False
) -> FeedbackTest:
    """Test records for feedback, given their Gram.

    With fewer than eight block rows the test has little power; the last quarter is what follows.
    With feedthrough an answer within the sample cannot be told from it, so only later ones count.
    """
    found = _whitened(gram, feedthrough=feedthrough)
    statistic, degrees, p_value = found.correlation
    if p_value > SIGNIFICANCE:
        return FeedbackTest(statistic, degrees, p_value, 0.0, detected=False)
    m = len(found.layout.innovation)
    record = max(records, key=len)
    signals = _remainders(record, gram, found.layout, found.predictor, found.scale)
    e, u = signals[:, :m] @ found.white_e, signals[:, m:] @ found.white_u
    near, far = _near_and_far(e, u, gram.block_rows)
    background = far * found.samples
    return FeedbackTest(statistic, degrees, p_value, background, near > _STANDS_OUT * far)


def _whitened(gram: BlockGram, *, feedthrough: bool) -> _Whitened:
    layout = _layout(gram, feedthrough=feedthrough)
    scale = np.sqrt(np.diag(gram.matrix))
    scale[scale == 0.0] = 1.0
    scaled = gram.matrix / np.outer(scale, scale)
    keep = layout.innovation + layout.following
    predictor, rank = _predictor(scaled, layout.past, keep)
    remainder = scaled[np.ix_(keep, keep)] - predictor @ scaled[np.ix_(layout.past, keep)]
    m = len(layout.innovation)
    white_e, white_u = whitening(remainder[:m, :m]), whitening(remainder[m:, m:])
    degrees = white_e.shape[1] * white_u.shape[1]
    samples = gram.columns - rank
    correlation = Correlation(0.0, 0, 1.0)
    if degrees > 0 and samples > 0:
        statistic = float(samples * np.sum((white_e.T @ remainder[:m, m:] @ white_u) ** 2))
        p_value = float(scipy.special.chdtrc(degrees, statistic))
        correlation = Correlation(statistic, degrees, p_value)
    return _Whitened(layout, scale, predictor, white_e, white_u, samples, correlation)


def _layout(gram: BlockGram, *, feedthrough: bool) -> _Layout:
    shifts = gram.block_rows
    now = shifts - max(1, shifts // 4)
    past = gram.output_rows(0, now) + gram.input_rows(0, now)
    following = now
    if feedthrough:
        past += gram.input_rows(now, now + 1)
        following = now + 1
    return _Layout(past, gram.output_rows(now, now + 1), gram.input_rows(following, shifts))


def _predictor(gram: FloatArray, past: list[int], keep: list[int]) -> tuple[FloatArray, int]:
    """Return the regression of `keep` on the past, and the rank of the past."""
    root = truncated_inverse(gram[np.ix_(past, past)]).root
    return gram[np.ix_(keep, past)] @ root @ root.T, root.shape[1]


def whitening(covariance: FloatArray) -> FloatArray:
    """Return uncorrelated combinations of unit variance, (signals, rank), without rounding's."""
    size = len(covariance)
    deviation = np.sqrt(np.diag(covariance).clip(min=0.0))
    heard = np.flatnonzero(deviation > SMALLEST_REMAINDER)
    if len(heard) == 0:
        return np.zeros((size, 0))
    unit = np.outer(deviation[heard], deviation[heard])
    values, vectors = scipy.linalg.eigh(covariance[np.ix_(heard, heard)] / unit)
    kept = values > _DEPENDENT * values[-1]
    whitening = np.zeros((size, int(kept.sum())))
    whitening[heard] = vectors[:, kept] / np.sqrt(values[kept]) / deviation[heard, np.newaxis]
    return whitening


def _remainders(
    record: IoData, gram: BlockGram, layout: _Layout, predictor: FloatArray, scale: FloatArray
) -> FloatArray:
    """Return what the past does not predict, (columns, innovation and following)."""
    z = np.hstack([record.y, record.u])[:BACKGROUND_SAMPLES]
    channels = z.shape[1]
    keep = layout.innovation + layout.following
    # Row i of the Hankel matrix is channel i % channels, shifted by i // channels samples.
    weight = np.zeros((len(scale), len(keep)))
    weight[layout.past] = -predictor.T
    weight[keep, np.arange(len(keep))] = 1.0
    # The Gram's scale holds the number of columns.
    weight *= np.sqrt(gram.columns) / scale[:, np.newaxis]
    columns = len(z) - gram.block_rows + 1
    remainders = np.zeros((columns, len(keep)))
    for shift in range(gram.block_rows):
        rows = slice(shift * channels, (shift + 1) * channels)
        remainders += z[shift : shift + columns] @ weight[rows]
    return remainders


def _near_and_far(e: FloatArray, u: FloatArray, block_rows: int) -> tuple[float, float]:
    """Return the sum of squared correlations at lag zero, and the largest at distant lags."""
    columns = len(e)
    length = scipy.fft.next_fast_len(2 * columns)
    e_transform, u_transform = scipy.fft.rfft(e, length, axis=0), scipy.fft.rfft(u, length, axis=0)
    power = np.zeros(length)
    for i in range(e.shape[1]):
        cross = scipy.fft.irfft(e_transform[:, [i]].conj() * u_transform, length, axis=0)
        power += np.sum(cross**2, axis=1)
    lags = np.arange(length)
    lags = np.abs(np.where(lags > length // 2, lags - length, lags))
    distant = (lags > block_rows) & (lags < columns // 2)
    if not distant.any():
        return float(power[0]) / columns**2, 0.0
    # Fewer products at a longer lag: the variance falls with their number.
    far = power[distant] / (columns - lags[distant])
    return float(power[0]) / columns**2, float(far.max()) / columns
