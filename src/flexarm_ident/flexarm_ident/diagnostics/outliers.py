"""Outliers: single samples of a channel far off both neighbours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.arrays import runs
from flexarm_core.labels import counted, instant
from flexarm_ident.diagnostics.check import Check, each_record
from flexarm_ident.records.data_warning import Kind
from flexarm_ident.records.signals import CONSTANT_SHARE, constant_share

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

# A jump there and back, in medians of the step from sample to sample. In normal noise a sample is
# beyond ten of them once in 3e14, in noise with exponential tails beyond fifteen once in 2e7.
_JUMP = 15.0
# The jump in deviations of the signal: smaller ones cost little.
_SIZE = 1.0
# A vibration of high frequency jumps again and again; around an outlier the signal is quiet.
_AROUND = 5
_QUIET = 0.25
# An input that steps so many samples before explains the output's jump, unless it is larger by this
# factor than nine of ten jumps behind such steps.
_ANSWER = 3
_UNUSUAL = 3.0
_USUAL_SHARE = 0.9
_FEWEST = 50
# An input may jump as it likes, but not so many deviations, in so few rows, without an answer of
# any output within so many samples, behind its own row, which may be spoilt as well.
_INPUT_SIZE, _STRAYS = 10.0, 3
_REPLY = (2, 12)


def outliers(record: IoData) -> Iterator[DataWarning]:
    """Yield the channels of a record that have outliers, with their number and size."""
    explained = _answered(record)
    for name, y in zip(record.outputs, record.y.T, strict=True):
        yield from _warnings(record, name, y, _jumps(y, explained))
    for name, u in zip(record.inputs, record.u.T, strict=True):
        rows = _strays(u)
        yield from _warnings(record, name, u, rows[~_replied(record, rows)])


def _warnings(
    record: IoData, name: str, x: FloatArray, rows: NDArray[np.intp]
) -> Iterator[DataWarning]:
    if not len(rows):
        return
    usual = np.delete(x, rows)
    others = np.delete(np.arange(len(x)), rows)
    sizes = np.abs(x[rows] - np.interp(rows, others, usual)) / usual.std()
    largest = float(sizes.max())
    yield _KIND(
        f"{name} has {counted(len(rows), 'outlier')}, the largest {largest:.3g} deviations at "
        f"{instant(int(rows[np.argmax(sizes)]), record.dt_s)}: fill them from their "
        "neighbours, or set them to NaN for missing (empty the cells of a CSV file), "
        "and check the wiring",
        {
            "count": float(len(rows)),
            "largest": largest,
            "first_row": float(rows[0]),
            "last_row": float(rows[-1]),
        },
        channel=name,
    )


def _replied(record: IoData, rows: NDArray[np.intp]) -> BoolArray:
    """Mark the rows behind which an output moves as it does after strong inputs, as after a blow.

    An input so large would move it by more than it does in nine of ten samples.
    """
    replied = np.zeros(len(rows), dtype=np.bool_)
    for y in record.y.T:
        size = np.abs(np.diff(y))
        limit = _UNUSUAL * float(np.quantile(size, _USUAL_SHARE))
        behind = (slice(row + _REPLY[0] - 1, row + _REPLY[1]) for row in rows.tolist())
        replied |= np.array([size[each].max(initial=0.0) > limit for each in behind], np.bool_)
    return replied


def _strays(u: FloatArray) -> NDArray[np.intp]:
    """Return the rows of an input that are far off all others, up to three in a row."""
    none = np.empty(0, dtype=np.intp)
    if len(u) < _FEWEST or constant_share(u) > CONSTANT_SHARE:
        return none
    with np.errstate(over="ignore"):
        off, step = np.abs(u - np.median(u)), np.abs(np.diff(u))
    low, high = np.quantile(u, (0.16, 0.84))
    # An input that rests most of the time has its usual steps alone.
    limit = _INPUT_SIZE * 0.5 * float(high - low) or _JUMP * float(np.median(step[step > 0.0]))
    alone = [
        np.arange(first, last)
        for first, last in runs(off > limit).tolist()
        if last - first <= _STRAYS
        and np.max(off[max(0, first - _AROUND) : first], initial=0.0) < _QUIET * off[first]
        and np.max(off[last : last + _AROUND], initial=0.0) < _QUIET * off[last - 1]
    ]
    return np.concatenate([none, *alone])


def _jumps(x: FloatArray, explained: BoolArray) -> NDArray[np.intp]:
    """Return the rows of a signal that jump off both neighbours and stand alone.

    Rows in which the jumps are explained are compared with each other.
    """
    none = np.empty(0, dtype=np.intp)
    if len(x) < _FEWEST or constant_share(x) > CONSTANT_SHARE:
        return none
    with np.errstate(over="ignore"):
        steps = np.diff(x)
    step = np.abs(steps)
    usual = float(np.median(step)) or float(np.median(step[step > 0.0]))
    there_and_back = steps[:-1] * np.sign(steps[1:]) < 0.0
    jump = np.where(there_and_back, np.minimum(step[:-1], step[1:]), 0.0)
    low, high = np.quantile(x, (0.16, 0.84))
    limit = max(_JUMP * usual, _SIZE * 0.5 * float(high - low))
    inner = explained[1:-1]
    answer = _UNUSUAL * float(np.quantile(jump[inner], _USUAL_SHARE)) if inner.any() else 0.0
    rows = np.flatnonzero(jump > np.where(inner, max(limit, answer), limit)) + 1
    return (
        rows[[_is_alone(step, row, jump[row - 1]) for row in rows.tolist()]] if len(rows) else none
    )


def _is_alone(steps: FloatArray, row: int, jump: float) -> bool:
    """Return whether the steps around a jump are small, but for its own two."""
    before, after = steps[max(0, row - 1 - _AROUND) : row - 1], steps[row + 1 : row + 1 + _AROUND]
    return bool(np.max(np.concatenate([before, after]), initial=0.0) < _QUIET * jump)


def _answered(record: IoData) -> BoolArray:
    """Return the rows in which an output may answer a step of an input."""
    steps = np.abs(np.diff(record.u, axis=0, prepend=record.u[:1]))
    caused = np.any(steps > _JUMP * np.median(steps, axis=0), axis=1)
    # A controller answers an outlier in the same row.
    first = 1 if record.closed_loop else 0
    answered = np.zeros(len(caused), dtype=np.bool_)
    # The steps before the record are not known.
    answered[: _ANSWER + 1] = True
    for lag in range(first, _ANSWER + 1):
        answered[lag:] |= caused[: len(caused) - lag]
    return answered


_KIND = Kind(
    "outliers",
    "Outliers",
    "a sample jumps off both neighbours by 15 usual steps and a deviation, alone, and no step of"
    " an input explains it; in an input up to three are 10 deviations off, and no output answers",
    "set it to NaN, or empty its cell in the CSV file",
)
CHECKS = (Check(each_record(outliers), (_KIND,)),)
