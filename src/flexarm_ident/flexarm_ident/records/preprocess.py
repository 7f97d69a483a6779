"""Preparation of a record for identification (section 2.5)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy

from flexarm_core.arrays import column_range, runs
from flexarm_core.channels import CHANNELS
from flexarm_core.errors import DataError
from flexarm_core.labels import counted, instant
from flexarm_ident.records.data_warning import CONVERTED, DROPOUTS
from flexarm_ident.records.iodata import as_records
from flexarm_ident.records.signals import CONSTANT_SHARE, FEW_LEVELS, constant_share, in_range, look

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

ZERO_MEAN_OUTPUTS = tuple(each.name for each in CHANNELS if each.quantity == "moment")
BIASES = ("rest", "first", "mean", "none")
_LONGEST_REST_S = 1.0
# The mean of fewer samples is noise that would be added to the whole record.
_SHORTEST_REST = 30
# A mean of that many standard deviations is not an operating point that a model could explain.
_ALMOST_ALL = 1000.0
# A slower sensor, such as a camera, holds its value at more steps than this.
_HELD = 0.4
# Equal samples up to which a stretch is a drop-out, and steps on either side that tell.
_LONGEST, _SIDE = 20, 2
# How much larger a jump is than the steps beside it, and in usual errors of a cubic through the
# neighbours: that of a held value, and that away to a level or back.
_LARGER, _BACK, _AWAY = 1.5, 10.0, 15.0
_FEWEST, _MOST, _RARE = 2, 0.03, 0.98
# Single samples show a level when most jumps, so many or more, go to it.
_SINGLE, _AROUND, _QUIET = 5, 8, 0.25
_FEWEST_SAMPLES = 50


def preprocess(
    data: IoData,
    *,
    compensation: Literal["remove", "keep"] = "remove",
    bias: str = "rest",
    zero_mean: Sequence[str] = ZERO_MEAN_OUTPUTS,
    cutoff_hz: float | None = None,
    filter_input: bool = True,
) -> IoData:
    """Prepare a record as section 2.5 does, with defaults that do no damage.

    The steps are: drop-outs of sensors set to missing, Coulomb compensation removed from the input
    (section 2.4.3), output biases removed, strain gauges forced to zero mean, low-pass filter.

    The mean of a position is legitimate signal (a square wave between 0 and 3 V has one), so the
    default bias of an output is its mean over the rest at the start: the samples before the input
    first changes, at most 1 s. A record that starts with fewer than 30 such samples keeps its
    offsets; the initial state of the estimated model absorbs most of them. A bare beam at rest is
    not bent, so the gauges can always be forced to zero mean. A channel whose mean exceeds a
    thousand of its standard deviations has an offset and no signal in it: it is removed, with a
    notice, unless `bias` is 'none'. One that is beyond the range of numbers that can be computed
    with is multiplied by a power of ten, see `signals.in_range`.

    The thesis filters the outputs only, at 50 Hz. That adds the filter's poles to the model and
    colours the noise, so nothing is filtered by default; a `cutoff_hz` filters inputs and outputs
    alike, which leaves the input-output relation as it is.

    Parameters
    ----------
    data : IoData
        Record of one experiment.
    compensation : {'remove', 'keep'}
        Treatment of the Coulomb compensation in the input.
    bias : {'rest', 'first', 'mean', 'none'}
        Offset removed from each output: mean of the initial rest, first sample (step 2 of
        section 2.5), mean of the record, or nothing.
    zero_mean : sequence of str
        Outputs whose mean is always subtracted; those that the record lacks are skipped.
    cutoff_hz : float, optional
        Cut-off of the second-order Butterworth low-pass filter; the thesis has 50 Hz.
    filter_input : bool
        Filter the input with the same filter. False is the thesis's way.

    Returns
    -------
    IoData
        The prepared record. The reference is shifted and filtered with the first output, so that
        a linear control law still holds between the channels.

    Raises
    ------
    DataError
        If the cut-off is not below the Nyquist frequency.
    """
    data = in_range(without_dropouts(data))
    prepared = remove_compensation(data) if compensation == "remove" else data
    prepared = _subtract(prepared, _bias(prepared, bias, zero_mean))
    if bias != "none":
        prepared = _without_offsets(prepared)
    _check_cutoff(prepared, cutoff_hz)
    if cutoff_hz is not None:
        prepared = low_pass(prepared, cutoff_hz, filter_input=filter_input)
    return prepared


def remove_compensation(data: IoData) -> IoData:
    """Subtract the recorded Coulomb compensation from the input (section 2.4.3)."""
    return replace(data, u=data.effort, compensation=None)


def low_pass(data: IoData, cutoff_hz: float, *, filter_input: bool = True) -> IoData:
    """Filter with a second-order Butterworth low-pass, started in its steady state.

    Parameters
    ----------
    data : IoData
        Record of one experiment.
    cutoff_hz : float
        Frequency of -3 dB.
    filter_input : bool
        Filter input, compensation and reference too, so that the input-output relation stays.
    """
    b, a = scipy.signal.butter(2, cutoff_hz, fs=1.0 / data.dt_s)
    steady = scipy.signal.lfilter_zi(b, a)

    def filtered(x: FloatArray) -> FloatArray:
        start = np.multiply.outer(steady, x[0])
        return np.asarray(scipy.signal.lfilter(b, a, x, axis=0, zi=start)[0])

    if not filter_input:
        return replace(data, y=filtered(data.y))
    return replace(
        data,
        u=filtered(data.u),
        y=filtered(data.y),
        compensation=None if data.compensation is None else filtered(data.compensation),
        reference=None if data.reference is None else filtered(data.reference),
    )


def output_scale(data: IoData | Sequence[IoData]) -> FloatArray:
    """Return the factors, (outputs,), that bring each output's maximum to the input's.

    That is step 4 of section 2.5. The method 'orse_thesis' scales the products of the data by them,
    and C back. An output that is zero throughout has the factor 1.
    """
    records = as_records(data)
    largest_u = max(float(np.abs(column_range(record.u)).max()) for record in records)
    largest_y = np.max([np.abs(column_range(record.y)).max(axis=0) for record in records], axis=0)
    usable = (largest_y > 0.0) & (largest_u > 0.0)
    factors = np.divide(largest_u, largest_y, out=np.ones_like(largest_y), where=usable)
    return np.asarray(factors)


def _bias(data: IoData, kind: str, zero_mean: Sequence[str]) -> FloatArray:
    mean = np.asarray(data.y[data.usable].mean(axis=0))
    if kind == "rest":
        level = _rest_level(data)
    elif kind == "first":
        level = data.y[0]
    elif kind == "mean":
        level = mean
    elif kind == "none":
        level = np.zeros_like(mean)
    else:
        raise DataError(f"{data.label}: bias must be rest, first, mean or none: {kind!r}")
    return np.where(np.isin(data.outputs, list(zero_mean)), mean, level)


def _rest_level(data: IoData) -> FloatArray:
    moved = np.flatnonzero(np.any(data.u != data.u[0], axis=1))
    rest = min(moved[0] if len(moved) else len(data), round(_LONGEST_REST_S / data.dt_s))
    if rest < _SHORTEST_REST or np.any(data.u[0] != 0.0):
        return np.zeros(data.y.shape[1])
    return np.asarray(data.y[:rest].mean(axis=0))


def _subtract(data: IoData, bias: FloatArray) -> IoData:
    reference = None if data.reference is None else data.reference - data.of_tracked(bias)
    return replace(data, y=data.y - bias, reference=reference)


def _without_offsets(data: IoData) -> IoData:
    """Remove the means that exceed all signal by far, with a notice; of a constant output all."""
    inputs, outputs = _offsets(data.u), _offsets(data.y)
    is_constant = _is_constant(data.y)
    # The mean would leave rounding.
    outputs[is_constant] = data.y[0, is_constant]
    inputs[_is_constant(data.u)] = 0.0
    if not (inputs.any() or outputs.any()):
        return data
    offsets_of = zip((*data.inputs, *data.outputs), (*inputs, *outputs * ~is_constant), strict=True)
    notices = [
        CONVERTED(
            f"{name} had an offset of {offset:.6g}, which was removed",
            {"offset": float(offset)},
            channel=name,
        )
        for name, offset in offsets_of
        if offset != 0.0
    ]
    changed = _subtract(data, outputs)
    return replace(changed, u=changed.u - inputs, notices=(*data.notices, *notices))


def _offsets(values: FloatArray) -> FloatArray:
    mean, deviation = values.mean(axis=0), values.std(axis=0)
    return np.where(np.abs(mean) > _ALMOST_ALL * deviation, mean, 0.0)


def _is_constant(values: FloatArray) -> BoolArray:
    low, high = column_range(values)
    return np.asarray(low == high)


def _check_cutoff(data: IoData, cutoff_hz: float | None) -> None:
    nyquist_hz = 0.5 / data.dt_s
    if cutoff_hz is not None and not 0.0 < cutoff_hz < nyquist_hz:
        raise DataError(
            f"{data.label}: cutoff_hz must lie between 0 and the Nyquist frequency "
            f"{nyquist_hz:g} Hz: {cutoff_hz:g}; lower it (--cutoff, 0 for no filter)"
        )


def without_dropouts(record: IoData) -> IoData:
    """Return a record whose drop-outs are missing samples, with a notice on each such output."""
    dropped = np.column_stack([_dropped(y) for y in record.y_measured.T])
    if not dropped.any():
        return record
    missing = dropped if record.missing is None else dropped | record.missing
    return replace(
        record,
        y=np.where(missing, np.nan, record.y),
        missing=missing,
        notices=(*record.notices, *_notices(record, dropped)),
    )


def _notices(record: IoData, dropped: BoolArray) -> Iterator[DataWarning]:
    for name, rows in zip(record.outputs, dropped.T, strict=True):
        if rows.any():
            count, places = int(rows.sum()), len(runs(rows))
            first = int(np.argmax(rows))
            yield DROPOUTS(
                f"{name} drops out in {counted(count, 'sample')} at {counted(places, 'place')}, "
                f"first at {instant(first, record.dt_s)}: it jumps to one level, or keeps its "
                "value, and jumps back; these samples count as missing: check wire, supply and bus",
                {"missing": float(count), "places": float(places), "first_row": float(first)},
                channel=name,
            )


def _dropped(y: FloatArray) -> BoolArray:
    """Return the rows of a channel, NaN where not measured, that were not measured."""
    known = np.flatnonzero(~np.isnan(y))
    dropped = np.zeros(len(y), dtype=np.bool_)
    x = y[known]
    if (
        len(x) < _FEWEST_SAMPLES
        or constant_share(x) > CONSTANT_SHARE
        or len(np.unique(look(x))) <= FEW_LEVELS
    ):
        return dropped
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(x)
        usual = _usual_error(x)
        found = _stretches(x, np.abs(steps), usual) | _single_levels(x, steps, usual)
    # What is so frequent is the signal itself.
    if found.mean() <= _MOST:
        dropped[known] = found
    return dropped


def _stretches(x: FloatArray, size: FloatArray, usual: float) -> BoolArray:
    """Mark the equal samples, two or more, that a jump ends, and for a level begins as well."""
    equal = size == 0.0
    if equal.mean() > _HELD:
        return np.zeros(len(x), dtype=np.bool_)
    holds = runs(equal)
    first, last = holds.T
    # A stretch needs two steps before the one that leads to it, and two behind that back.
    is_inner = (first >= _SIDE + 1) & (last + _SIDE < len(size)) & (last - first < _LONGEST)
    holds = holds[is_inner]
    first, last = holds.T
    before = np.maximum(size[first - 2], size[first - 3])
    after = np.maximum(size[last + 1], size[last + 2])
    away, back = size[first - 1], size[last]
    both = np.minimum(away, back)
    is_level = (away > _LARGER * before) & (back > _LARGER * after) & (both > _AWAY * usual)
    # A peak that is cut off begins and ends with steps like others.
    is_level &= (x[first] > x.min()) & (x[first] < x.max()) | (both > np.quantile(size, _RARE))
    # A signal of coarse levels rests by itself.
    is_continuous = equal.mean() <= _MOST
    is_held = (last - first > 1) & (back > _LARGER * np.maximum(before, after))
    certain = is_level | (is_held & (back > _BACK * usual) & is_continuous)
    if np.count_nonzero(certain) < (1 if is_continuous else _FEWEST):
        return np.zeros(len(x), dtype=np.bool_)
    levels, counts = np.unique(x[first[certain]], return_counts=True)
    found = np.isin(x, levels[counts >= _FEWEST])
    for begin, end in holds[certain | is_continuous].tolist():
        # The first sample of a held value was measured.
        found[begin + 1 : end + 1] = True
    return found


def _single_levels(x: FloatArray, steps: FloatArray, usual: float) -> BoolArray:
    """Mark the samples at a level to which most jumps there and back of single samples go."""
    away = np.where(steps[:-1] * steps[1:] < 0.0, np.minimum(*np.abs([steps[:-1], steps[1:]])), 0.0)
    low, high = np.quantile(x, (0.16, 0.84))
    rows = np.flatnonzero(away > max(_AWAY * usual, 0.5 * float(high - low))) + 1
    if len(rows) < _SINGLE:
        return np.zeros(len(x), dtype=np.bool_)
    error = _cubic_errors(x)
    padded = np.pad(error, _AROUND)
    # A jump spoils the cubics through it, up to two samples off.
    around = np.array([*range(_AROUND - 2), *range(_AROUND + 3, 2 * _AROUND + 1)])
    alone = rows[padded[rows[:, np.newaxis] + around].max(axis=1) < _QUIET * error[rows]]
    levels, counts = np.unique(x[alone], return_counts=True)
    return np.isin(x, levels[(counts >= _SINGLE) & (2 * counts > len(alone))])


def _cubic_errors(x: FloatArray) -> FloatArray:
    """Return the distances of samples from the cubics through their four neighbours."""
    between = (4.0 * (x[1:-3] + x[3:-1]) - x[:-4] - x[4:]) / 6.0
    return np.pad(np.abs(x[2:-2] - between), 2)


def _usual_error(x: FloatArray) -> float:
    """Return the median distance of samples from their neighbours' cubics, at least a level's."""
    steps = np.abs(np.diff(x))
    return max(float(np.median(_cubic_errors(x))), float(steps[steps > 0.0].min(initial=np.inf)))
