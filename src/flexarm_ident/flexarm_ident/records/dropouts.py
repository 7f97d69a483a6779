"""Drop-outs: samples of an output at which its sensor sent 0, another level or its last value."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.arrays import runs
from flexarm_core.labels import counted, instant
from flexarm_ident.records.data_warning import DROPOUTS
from flexarm_ident.records.signals import CONSTANT_SHARE, FEW_LEVELS, constant_share, look

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

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
