"""Sampling of a table by its column of times: the rate, and the places of the rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.clock import nominal_rate_hz
from flexarm_core.labels import time_unit_s
from flexarm_ident.importing.csv_table import CsvImportError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.importing.csv_table import CsvTable

# Largest difference of a step from whole periods: times are often printed with few digits.
STEP_TOLERANCE = 0.1
# Largest relative change of a rate within the file.
_RATE_CHANGE = 1e-3
_HALF_A_STEP = 0.5
# A hole of so many periods is not filled later, so that it may have any length.
_LONG_HOLE = 5.0
_SLOW_HZ = 1.0


@dataclass(frozen=True, eq=False)
class Sampling:
    """Rate and places of rows.

    Attributes
    ----------
    rate_hz : float
        Sampling rate; a whole number where the times do not tell another.
    places : ndarray of int, (rows,)
        Periods from the first row to each; more than one from row to row where some are missing.
    """

    rate_hz: float
    places: NDArray[np.int64]


def sampling(table: CsvTable, column: str) -> Sampling:
    """Return the sampling of a table whose first column is its time.

    The time is in the unit that the column's name ends with, else in seconds. Rows may be missing:
    a step of several periods is a hole.

    Raises
    ------
    CsvImportError
        If the times do not rise by whole periods, their rate changes slowly, or more rows are
        missing than there are.
    """
    times_s = table.values[:, 0] * (time_unit_s(column) or 1.0)
    steps_s = np.diff(times_s)
    usual_s = float(np.median(steps_s))
    if usual_s <= 0:
        refuse_backwards(table, column, steps_s)
    _refuse_uneven(table, column, steps_s, usual_s)
    # Printed times round the median, not the mean of many.
    usual_s = float(np.mean(steps_s[steps_s < (1.0 + STEP_TOLERANCE) * usual_s]))
    periods = np.rint(steps_s / usual_s)
    _refuse_emptiness(table, column, steps_s, periods)
    places = np.concatenate([[0], np.cumsum(periods)]).astype(np.int64)
    beyond_s = np.where(periods >= _LONG_HOLE, steps_s - periods * usual_s, 0.0)
    even_s = times_s - np.concatenate([[0.0], np.cumsum(beyond_s)])
    rate_hz = float(places[-1] / (even_s[-1] - even_s[0]))
    _refuse_drift(table, column, even_s, Sampling(rate_hz, places))
    return Sampling(nominal_rate_hz(rate_hz, float(places[-1])), places)


def doubt(column: str, rate_hz: float) -> tuple[str, ...]:
    """Return the question whether times without a unit are in ms, where their rate is low."""
    if rate_hz >= _SLOW_HZ or time_unit_s(column):
        return ()
    return (
        f"column {column} gives {rate_hz:.3g} Hz: are the times in ms? Then call it {column}_ms",
    )


def _refuse_uneven(table: CsvTable, column: str, steps_s: FloatArray, usual_s: float) -> None:
    steps = steps_s / usual_s
    off = np.abs(steps - np.rint(steps).clip(min=1.0))
    off[steps >= _LONG_HOLE] = 0.0
    worst = int(np.argmax(off))
    if off[worst] > STEP_TOLERANCE:
        refuse_backwards(table, column, steps_s)
        raise CsvImportError(
            f"{table.path}, line {table.lines[worst + 1]}: column {column} has an irregular step, "
            f"{steps_s[worst]:.6g} s, usually {usual_s:.6g} s: {_remedy(usual_s)}, or cut the file"
        )


def _refuse_emptiness(
    table: CsvTable, column: str, steps_s: FloatArray, periods: FloatArray
) -> None:
    if periods.sum() - len(periods) > len(table.lines):
        longest = int(np.argmax(periods))
        raise CsvImportError(
            f"{table.path}, line {table.lines[longest + 1]}: column {column} jumps by "
            f"{steps_s[longest]:.6g} s, and more rows are missing in all than there are: make a "
            "file of each part, and give them together"
        )


def _refuse_drift(table: CsvTable, column: str, times_s: FloatArray, found: Sampling) -> None:
    """Refuse times whose steps change slowly: each is like the usual one, their sum is not.

    A rate that changes evenly by a part d puts the middle of N samples d N / 8 samples off.
    """
    places = found.places
    off = np.abs((times_s - times_s[0]) * found.rate_hz - places)
    if off.max() <= _HALF_A_STEP + _RATE_CHANGE * places[-1] / 8:
        return
    tenth = max(1, len(times_s) // 10)
    first_hz, last_hz = (
        float((places[end] - places[start]) / (times_s[end] - times_s[start]))
        for start, end in ((0, tenth), (-1 - tenth, -1))
    )
    raise CsvImportError(
        f"{table.path}: column {column} has no even rate: {first_hz:.6g} Hz at first, "
        f"{last_hz:.6g} Hz at last, up to {off.max():.1f} samples off even steps: "
        f"{_remedy(1.0 / found.rate_hz)}"
    )


def refuse_backwards(table: CsvTable, column: str, steps_s: FloatArray) -> None:
    """Raise a CsvImportError where a step of the times, (rows - 1,), is not above zero."""
    if np.all(steps_s > 0.0):
        return
    line = table.lines[int(np.argmax(steps_s <= 0.0)) + 1]
    raise CsvImportError(
        f"{table.path}, line {line}: column {column} does not increase: sort the rows, keep one of "
        "those with the same time, or name the column of the time"
    )


def _remedy(usual_s: float) -> str:
    rate_hz = float(f"{1.0 / usual_s:.3g}")
    return f"resample it by a map with rate_hz: {rate_hz:g} beside the time"
