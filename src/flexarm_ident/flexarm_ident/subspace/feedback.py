"""Is there a controller behind the data? A test for feedback from outputs to inputs.

The part of an output that its past does not predict, the innovation, is noise. Without feedback no
later input knows of it. The correlation of the innovation with what the past does not predict of
the inputs that follow is therefore tested for zero. All it takes is the block Gram: its first rows
are the past, the next ones hold the innovation and the inputs that follow.

Friction bends the test: what a linear model leaves of it looks like innovation, but returns
whenever the input does the same again. So the correlation must also stand out of what is found
at distances at which no controller answers.
An input that lacks its low frequencies, such as noise from 20 Hz up, remembers longer than the past
that the Gram holds, and can pass for feedback. `is_closed_loop` judges a record by the same
correlation, with a longer past of the input, and so that a jump of the set-point counts as one.
Haugh, "Checking the independence of two covariance-stationary time series", JASA 71 (1976);
Gustavsson, Ljung, Soderstrom, "Identification of processes in closed loop", Automatica 13 (1977);
Rousseeuw, Leroy, "Robust regression and outlier detection", Wiley 1987.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

# One false alarm in a million records.
SIGNIFICANCE = 1e-6
_STANDS_OUT = 1.5
_SMALLEST_EIGENVALUE = 1e-13
# Below this part of a signal's RMS, what is left of it is rounding.
_SMALLEST_REMAINDER = 1e-5
_DEPENDENT = 1e-9
# As many samples show the background at distant lags, and the kind of loop.
BACKGROUND_SAMPLES = 2**14
# An input that changes at fewer of the samples carries no noise from sample to sample.
_SELDOM = 0.1
# Samples of the past: of the outputs, and of the input as far as a filtered one remembers.
_OUTPUT_MEMORY = 15
_INPUT_MEMORY = 100
# A controller answers within the sample or this many less one later.
_ANSWERED_WITHIN = 5
# Robust standard deviations: what is larger is clipped in a correlation, and left out of a fit.
_CLIP = 3.0
_OUTLIER = 4.0
_NORMAL_MAD = 1.4826
_REFITS = 3


@dataclass(frozen=True)
class FeedbackTest:
    """Outcome of the test.

    Attributes
    ----------
    statistic : float
        Sum of squared canonical correlations times the samples.
    degrees : int
        What it should be without feedback: the degrees of freedom of its chi-square distribution.
        0 when there is no noise that could tell.
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
    """Correlation of the innovation with later inputs: statistic, degrees, p-value, as below."""

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
    """Whether later inputs know of the outputs' innovation: by feedback, or seemingly, by friction.

    Only inputs after the sample count, so that it does not matter whether there is feedthrough.

    Parameters
    ----------
    gram : BlockGram
        Products of the data.

    Returns
    -------
    bool
        Whether the correlation is significant, at one false alarm in a million records.
    """
    return _whitened(gram, feedthrough=True).correlation.p_value <= SIGNIFICANCE


def feedback_test(
    records: Sequence[IoData], gram: BlockGram, *, feedthrough: bool = False
) -> FeedbackTest:
    """Test records for feedback.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    gram : BlockGram
        Their Gram, of eight block rows or more to be of use; the last quarter is what follows.
    feedthrough : bool
        Whether the output may follow the input at once. Then an answer within the sample cannot be
        told from it, and only later ones count.

    Returns
    -------
    FeedbackTest
        Statistic and verdict.
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


def is_closed_loop(record: IoData) -> bool | None:
    """Judge by inputs and outputs alone whether a controller made the input.

    In a closed loop every command is computed from noisy samples: what the past does not predict of
    the outputs, their innovation, is known to what it does not predict of the inputs from that
    sample on. The plant has no feedthrough: row `k` of the input answers row `k` of the outputs.
    Three things are done so that nothing else passes for feedback, and nothing hides it:

    - The past holds 100 samples of the input, so that a filtered excitation has told all it knows.
    - Remainders are clipped, and the prediction is fitted once to all samples and once to those
      that it predicts well: set-points jump seldom, and their jumps are much larger than noise.
    - An input that keeps its value at nine samples of ten lets no noise through, whatever turns it
      round now and then.

    A loop whose noise does not show in the input, as under a set-point that is white noise itself
    and much stronger, is judged open: it does the identification no harm either.

    Parameters
    ----------
    record : IoData
        The record as it was measured; the first 16384 samples are looked at.

    Returns
    -------
    bool or None
        None where the record is too short, its outputs have no noise that could tell, or its
        values are so large that their squares overflow.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        u, y = _unit(record.u[:BACKGROUND_SAMPLES]), _unit(record.y[:BACKGROUND_SAMPLES])
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        return None
    if np.mean(np.any(np.diff(u, axis=0), axis=1)) < _SELDOM:
        return False
    columns = len(u) - _INPUT_MEMORY - _ANSWERED_WITHIN + 1
    memory = _INPUT_MEMORY * u.shape[1] + _OUTPUT_MEMORY * y.shape[1]
    if columns < 2 * memory:
        return None
    past = np.hstack(
        [_shifted(y, -_OUTPUT_MEMORY, 0, columns), _shifted(u, -_INPUT_MEMORY, 0, columns)]
    )
    present = np.hstack([_shifted(y, 0, 1, columns), _shifted(u, 0, _ANSWERED_WITHIN, columns)])
    m = y.shape[1]
    kept = np.ones(columns, dtype=np.bool_)
    remainder = _unpredicted(past, present, kept)
    verdicts = [_is_answered(remainder[:, :m], remainder[:, m:], kept, memory)]
    for _ in range(_REFITS):
        following = remainder[:, m:]
        usual = np.all(np.abs(following) <= _OUTLIER * _deviation(following[kept]), axis=1)
        if usual.sum() < 2 * memory:
            break
        kept = usual
        remainder = _unpredicted(past, present, kept)
    verdicts.append(_is_answered(remainder[:, :m], remainder[:, m:], kept, memory))
    told = [verdict for verdict in verdicts if verdict is not None]
    return any(told) if told else None


def _unit(signals: FloatArray) -> FloatArray:
    """Return signals less their mean, with unit RMS where they change at all."""
    centred = signals - signals.mean(axis=0)
    rms = np.sqrt(np.mean(centred**2, axis=0))
    return np.asarray(centred / np.where(rms > 0.0, rms, 1.0))


def _shifted(signals: FloatArray, first: int, last: int, columns: int) -> FloatArray:
    """Return what stands `first` to `last` - 1 samples after each one with a whole past."""
    starts = range(_INPUT_MEMORY + first, _INPUT_MEMORY + last)
    return np.hstack([signals[start : start + columns] for start in starts])


def _unpredicted(past: FloatArray, present: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
    """Return what is left of the present by the regression on the past over the kept rows."""
    known = past[kept]
    values, vectors = scipy.linalg.eigh(known.T @ known, driver="evd")
    heard = values > _SMALLEST_EIGENVALUE * values[-1]
    basis = vectors[:, heard] / np.sqrt(values[heard])
    return np.asarray(present - past @ (basis @ (basis.T @ (known.T @ present[kept]))))


def _deviation(signals: FloatArray) -> FloatArray:
    """Return standard deviations by the median, which outliers do not move."""
    return np.asarray(_NORMAL_MAD * np.median(np.abs(signals), axis=0))


def _is_answered(
    e: FloatArray, following: FloatArray, kept: NDArray[np.bool_], memory: int
) -> bool | None:
    """Whether the kept inputs know of the innovation; None without innovation."""
    white_e, white_u = _white(e, kept), _white(following, kept)
    if white_e.shape[1] == 0:
        return None
    if white_u.shape[1] == 0:
        return False
    near, far = _near_and_far(white_e, white_u, _INPUT_MEMORY)
    share = kept.mean()
    # The rows that are left out are zero: the correlation is over the kept ones.
    statistic = (kept.sum() - memory) * near / share**2
    degrees = white_e.shape[1] * white_u.shape[1]
    p_value = scipy.special.chdtrc(degrees, statistic)
    return bool(p_value <= SIGNIFICANCE and near > _STANDS_OUT * far)


def _white(signals: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
    """Return clipped signals, uncorrelated and of unit variance over the kept rows, else zero."""
    limit = _CLIP * _deviation(signals[kept])
    clipped = np.clip(signals, -limit, limit)
    clipped -= clipped[kept].mean(axis=0)
    clipped[~kept] = 0.0
    return np.asarray(clipped @ _whitening(clipped.T @ clipped / kept.sum()))


def _whitened(gram: BlockGram, *, feedthrough: bool) -> _Whitened:
    layout = _layout(gram, feedthrough=feedthrough)
    scale = np.sqrt(np.diag(gram.matrix))
    scale[scale == 0.0] = 1.0
    scaled = gram.matrix / np.outer(scale, scale)
    keep = layout.innovation + layout.following
    predictor, rank = _predictor(scaled, layout.past, keep)
    remainder = scaled[np.ix_(keep, keep)] - predictor @ scaled[np.ix_(layout.past, keep)]
    m = len(layout.innovation)
    white_e, white_u = _whitening(remainder[:m, :m]), _whitening(remainder[m:, m:])
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
    """Return the regression of `keep` on the past, and the rank of the latter."""
    values, vectors = scipy.linalg.eigh(gram[np.ix_(past, past)])
    kept = values > _SMALLEST_EIGENVALUE * values[-1]
    basis = vectors[:, kept] / np.sqrt(values[kept])
    return gram[np.ix_(keep, past)] @ basis @ basis.T, int(kept.sum())


def _whitening(covariance: FloatArray) -> FloatArray:
    """Return combinations of unit variance and no correlation; rounding gives none."""
    size = len(covariance)
    deviation = np.sqrt(np.diag(covariance).clip(min=0.0))
    heard = np.flatnonzero(deviation > _SMALLEST_REMAINDER)
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
    """Return what the past does not predict over time, (columns, innovation and following)."""
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
