"""Closed-loop test of a record by its signals alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_ident.records.signals import NORMAL_MAD
from flexarm_ident.subspace.feedback import (
    BACKGROUND_SAMPLES,
    SIGNIFICANCE,
    STANDS_OUT,
    near_and_far,
    whitening,
)
from flexarm_ident.subspace.gram import stretches
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

# An input that changes at fewer of the samples carries no noise from sample to sample.
_SELDOM = 0.1
# Samples of the past of the outputs, and of the input with the memory of its filter.
_OUTPUT_MEMORY = 15
_INPUT_MEMORY = 100
# A controller answers within the sample or this many less one later.
_ANSWERED_WITHIN = 5
# Unpredicted part of an input's RMS above which it is an excitation rather than a law's noise.
_FRESH = 0.06
# Robust standard deviations above which a value is clipped in a correlation, or left out of a fit.
_CLIP = 3.0
_OUTLIER = 4.0
_REFITS = 3


class _Regression(NamedTuple):
    """Past and present of all rows, with the past's products with itself and with the present."""

    past: FloatArray
    present: FloatArray
    gram: FloatArray
    cross: FloatArray

    def remainder(self, kept: NDArray[np.bool_]) -> FloatArray:
        """Return the remainder of the present after regression on the past over the kept rows."""
        gram, cross = self.gram, self.cross
        if not kept.all():
            # They are few: their products are subtracted in a part of the time of those of all.
            left_out = self.past[~kept]
            gram = gram - left_out.T @ left_out
            cross = cross - left_out.T @ self.present[~kept]
        return np.asarray(self.present - self.past @ truncated_inverse(gram).solve(cross))


def judged_loop(record: IoData, *, feedthrough: bool = False) -> bool | None:
    """Judge as `is_closed_loop` does, by the longest stretch of a record between holes.

    Parameters
    ----------
    record : IoData
        The record, with holes or without.
    feedthrough : bool
        As in `is_closed_loop`.

    Returns
    -------
    bool or None
        None also where there is no such stretch, or no input.
    """
    longest = max(stretches(record.y_usable), key=lambda rows: rows.stop - rows.start, default=None)
    if longest is None or longest.stop - longest.start < 2 or not np.any(record.u):  # noqa: PLR2004
        return None
    return is_closed_loop(record.rows(longest), feedthrough=feedthrough)


def is_closed_loop(record: IoData, *, feedthrough: bool = False) -> bool | None:
    """Judge from inputs and outputs alone whether a controller made the input.

    In a closed loop every command is computed from noisy samples, so the innovation of the outputs
    is correlated with the unpredicted inputs from that sample on: row `k` of the input answers row
    `k` of the outputs. Three measures make the test robust:

    - The past holds 100 samples of the input, which cover the memory of a filtered excitation.
    - Remainders are clipped, and the prediction is fitted once to all samples and once to those
      that it predicts well: set-points jump seldom, and their jumps are much larger than noise.
    - An input that keeps its value at nine samples of ten transmits no noise and counts as open.

    A loop whose noise is hidden by a much stronger white set-point is judged open. It does not bias
    the identification either.

    Parameters
    ----------
    record : IoData
        The record as it was measured; its first 16384 samples are examined.
    feedthrough : bool
        The plant may have a feedthrough: an output that answers the input within the sample looks
        like a controller that does so. Where 6 % of the input or more are new in each sample, only
        later inputs are looked at then, and a controller without memory can stay unseen.

    Returns
    -------
    bool or None
        None where the record is too short, its outputs have no noise, or the squares of its values
        overflow.
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
    channels = y.shape[1], u.shape[1]
    kept = np.ones(columns, dtype=np.bool_)
    regression = _Regression(past, present, past.T @ past, past.T @ present)
    remainder = regression.remainder(kept)
    look = _later_answered if feedthrough else _is_answered
    verdicts = [look(remainder, channels, kept, memory)]
    for _ in range(_REFITS):
        following = remainder[:, channels[0] :]
        usual = np.all(np.abs(following) <= _OUTLIER * _deviation(following[kept]), axis=1)
        if usual.sum() < 2 * memory:
            break
        kept = usual
        remainder = regression.remainder(kept)
    verdicts.append(look(remainder, channels, kept, memory))
    told = [verdict for verdict in verdicts if verdict is not None]
    return any(told) if told else None


def _unit(signals: FloatArray) -> FloatArray:
    """Return signals less their mean, with unit RMS where they change at all."""
    centred = signals - signals.mean(axis=0)
    rms = np.sqrt(np.mean(centred**2, axis=0))
    return np.asarray(centred / np.where(rms > 0.0, rms, 1.0))


def _shifted(signals: FloatArray, first: int, last: int, columns: int) -> FloatArray:
    """Return the samples shifted by `first` to `last` - 1, side by side."""
    starts = range(_INPUT_MEMORY + first, _INPUT_MEMORY + last)
    return np.hstack([signals[start : start + columns] for start in starts])


def _deviation(signals: FloatArray) -> FloatArray:
    """Return standard deviations estimated from medians, robust against outliers."""
    return np.asarray(NORMAL_MAD * np.median(np.abs(signals), axis=0))


def _later_answered(
    remainder: FloatArray, channels: tuple[int, int], kept: NDArray[np.bool_], memory: int
) -> bool | None:
    """Return whether inputs answer the innovation of a plant that may have a feedthrough."""
    answered = _is_answered(remainder, channels, kept, memory)
    outputs, inputs = channels
    present = remainder[:, outputs : outputs + inputs]
    if not answered or np.all(_deviation(present[kept]) < _FRESH):
        return answered
    unexplained = remainder - present @ np.linalg.lstsq(present[kept], remainder[kept])[0]
    later = np.delete(unexplained, np.s_[outputs : outputs + inputs], axis=1)
    found = _is_answered(later, channels, kept, memory)
    # Nothing is left of an output that an exact law made of the input, or the input of it.
    return answered if found is None else found


def _is_answered(
    remainder: FloatArray, channels: tuple[int, int], kept: NDArray[np.bool_], memory: int
) -> bool | None:
    """Return whether inputs correlate with the innovation; None without innovation.

    The remainders are those of the outputs and of the inputs that follow; `channels` are the
    numbers of outputs and of inputs.
    """
    outputs, _ = channels
    white_e, white_u = (_white(each, kept) for each in np.split(remainder, [outputs], axis=1))
    if white_e.shape[1] == 0:
        return None
    if white_u.shape[1] == 0:
        return False
    near, far = near_and_far(white_e, white_u, _INPUT_MEMORY)
    share = kept.mean()
    # The rows that are left out are zero: the correlation is over the kept ones.
    statistic = (kept.sum() - memory) * near / share**2
    degrees = white_e.shape[1] * white_u.shape[1]
    p_value = scipy.special.chdtrc(degrees, statistic)
    return bool(p_value <= SIGNIFICANCE and near > STANDS_OUT * far)


def _white(signals: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
    """Return clipped signals, uncorrelated and of unit variance over the kept rows, else zero."""
    limit = _CLIP * _deviation(signals[kept])
    clipped = np.clip(signals, -limit, limit)
    clipped -= clipped[kept].mean(axis=0)
    clipped[~kept] = 0.0
    return np.asarray(clipped @ whitening(clipped.T @ clipped / kept.sum()))
