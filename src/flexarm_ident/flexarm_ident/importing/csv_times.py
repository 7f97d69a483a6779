"""Sampling of a table by its column of times: the rate, and the places of the rows."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.clock import nominal_rate_hz
from flexarm_ident.importing.csv_cells import CsvImportError

if TYPE_CHECKING:
    from collections.abc import Sequence

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
# Times are within a last digit of their line, with one more for a clock that jitters.
_A_DIGIT, _TWO_DIGITS = 1.01, 2.01
_MOST_DIGITS, _WHOLE = 7, 0.02
_COUNTER = re.compile(
    r"[\W_]*(k|n|i|x|nr|no|row|index|count(er)?|samples?|sequence|number)[\W_]*",
    re.IGNORECASE,
)
# Nobody is asked for the unit of a few rows.
_FEWEST = 50
# Rigs are sampled below the first rate. Rates above the second need no question, those below the
# third are asked about, and motors are not sampled below the last.
_FASTEST_HZ, _FAST_HZ, _SLOW_HZ, _SLOW_MOTOR_HZ = 1e5, 10.0, 1.0, 0.5
# Relative distance at which a rate or step is the round one.
_ROUND = 2e-4
# Longer steps that people choose are whole minutes.
_LONG_STEP_S = 100.0
# Share of rows with the time of the row before that happens, and how often a clock is set.
_FEW_EQUAL, _FEW_JUMPS = 0.1, 5
_SMALLER_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_FAST_PLANT = re.compile(
    r"motor|torque|moment|current|voltage|volt|speed|veloc|omega|rpm|encoder|angle|accel|gyro|imu|"
    r"strain|gauge|force|pwm|duty|joint|drive|servo|(^|[\W_])(rad|deg|a|v|nm)([\W_]|$)",
    re.IGNORECASE,
)
_SLOW_PLANT = re.compile(
    r"temp|heat|furnace|oven|boiler|tank|level|flow|valve|reactor|humid|room|outdoor|kiln|celsius|"
    r"concentration|(^|[\W_])(ph|co2|degc)([\W_]|$)",
    re.IGNORECASE,
)


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

    Rows may be missing: a step of several periods is a hole. Times of few digits may differ from
    even ones by rounding.

    Raises
    ------
    CsvImportError
        If the times do not rise by whole periods, their rate changes slowly, or more rows are
        missing than there are.
    """
    times_s = table.values[:, 0]
    steps_s = np.diff(times_s)
    usual_s = float(np.median(steps_s))
    off = _off_whole(steps_s, usual_s)
    if off.max() > STEP_TOLERANCE:
        if rounded := _of_rounded_times(times_s, usual_s):
            return rounded
        _refuse_uneven(table, column, steps_s, int(np.argmax(off)))
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


def _of_rounded_times(times_s: FloatArray, usual_s: float) -> Sampling | None:
    """Return the sampling of even rows whose times have few digits; None where they are not so.

    Whole milliseconds make steps of 3, 3 and 4 ms at 300 Hz. The rows are even when all times are
    within their last digit of one line.
    """
    digit_s = _last_digit_s(times_s - times_s[0])
    steps_s = np.diff(times_s)
    if digit_s <= STEP_TOLERANCE * usual_s or steps_s.min() < 0.0:
        return None
    mean_s = float(steps_s[steps_s <= usual_s + _A_DIGIT * digit_s].mean())
    if mean_s <= 0.0:
        return None
    within = np.abs(steps_s - mean_s) <= _A_DIGIT * digit_s
    places = np.concatenate([[0.0], np.cumsum(np.where(within, 1.0, np.rint(steps_s / mean_s)))])
    # Of the rows that share a stamp only the first is at it: the others would bias the slope.
    new = 1 + np.flatnonzero(steps_s > 0.0)
    if len(new) < 2:  # noqa: PLR2004 - a line needs two points
        return None
    slope_s, _ = np.polyfit(places[new], times_s[new] - times_s[0], 1)
    off_s = times_s - times_s[0] - slope_s * places
    if np.ptp(off_s) > _TWO_DIGITS * digit_s or places[-1] > 2.0 * len(times_s):
        return None
    if np.diff(places).min() < 1.0:
        return None
    rate_hz = nominal_rate_hz(1.0 / float(slope_s), float(places[-1]))
    return Sampling(rate_hz, places.astype(np.int64))


def _last_digit_s(since_s: FloatArray) -> float:
    """Return the coarsest power of ten, s, of which all times are multiples; 0 without one."""
    for digits in range(_MOST_DIGITS):
        counts = since_s * 10.0**digits
        if np.abs(counts - np.rint(counts)).max() < _WHOLE:
            return float(10.0**-digits)
    return 0.0


def unit_question(
    table: CsvTable, column: str, names: Sequence[str], rate_hz: float
) -> tuple[str, ...]:
    """Ask for the unit of times that nothing gives, where s make a slow record.

    Slow plants are logged at steps that people choose, such as 0.5 s, 10 s or 15 min, and clocks of
    fast ones at whole numbers of hertz. What fits the second alone is refused until it is given; so
    are days of a motor. What fits the first, as 0.2 Hz does, is asked about, unless the names are
    those of slow plants.

    Parameters
    ----------
    table : CsvTable
        The rows.
    column : str
        Column of the times.
    names : sequence of str
        Names of the signals.
    rate_hz : float
        Rate, if the times are in s.

    Raises
    ------
    CsvImportError
        If they are hardly s.
    """
    if table.unit_given or rate_hz > _FAST_HZ or len(table.values) < _FEWEST:
        return ()
    words, times = " ".join(names), table.values[:, 0]
    fits = [
        unit
        for unit, s in _SMALLER_S.items()
        if _is_round(rate_hz / s) and _FAST_HZ < rate_hz / s < _FASTEST_HZ
    ]
    likely = " or ".join(fits or _SMALLER_S)
    lasts_s = float(np.ptp(times))
    advice = (
        f"column {column} gives {rate_hz:.4g} Hz over {_duration(lasts_s)} if its times are in s; "
        f"are they in {likely}? State it: --time '{column}:{fits[0] if fits else 'ms'}' or "
        f"--time '{column}:s' (time_unit in a map)"
    )
    is_slow_plant = _SLOW_PLANT.search(words) is not None
    is_fast_plant = _FAST_PLANT.search(words) is not None
    counts = abs(rate_hz - 1.0) < _ROUND and np.all(times == np.rint(times))
    if counts and not is_slow_plant and (is_fast_plant or _COUNTER.fullmatch(column)):
        raise CsvImportError(
            f"{table.path}: column {column} counts the rows, or has whole seconds: give the rate "
            f"as --time 200Hz, or its unit as --time '{column}:s' (rate_hz or time_unit in a map)"
        )
    is_too_slow = is_fast_plant and rate_hz < _SLOW_MOTOR_HZ
    if not is_slow_plant and (is_too_slow or (fits and not _is_chosen(1.0 / rate_hz))):
        raise CsvImportError(f"{table.path}: {advice}")
    return () if is_slow_plant or rate_hz >= _SLOW_HZ else (advice,)


def _is_round(rate_hz: float) -> bool:
    """Return whether a rate is a number of two digits, as those of timers are."""
    return abs(float(f"{rate_hz:.1e}") / rate_hz - 1.0) < _ROUND


def _is_chosen(period_s: float) -> bool:
    """Return whether people choose such a step in s: a round part of one, or whole ones."""
    minutes, tenths = period_s / 60.0, 20.0 * period_s
    if abs(minutes - round(minutes)) < _ROUND * minutes:
        return True
    return period_s < _LONG_STEP_S and abs(tenths - round(tenths)) < _ROUND * tenths


def _duration(seconds: float) -> str:
    return f"{seconds / 86400.0:.3g} days" if seconds > 86400.0 else f"{seconds:.4g} s"  # noqa: PLR2004


def _off_whole(steps_s: FloatArray, usual_s: float) -> FloatArray:
    """Return how far steps are off whole periods, in periods; long holes may have any length."""
    if usual_s <= 0.0:
        return np.full(len(steps_s), np.inf)
    steps = steps_s / usual_s
    off = np.abs(steps - np.rint(steps).clip(min=1.0))
    return np.where(steps >= _LONG_HOLE, 0.0, off)


def _refuse_uneven(table: CsvTable, column: str, steps_s: FloatArray, worst: int) -> None:
    refuse_backwards(table, column, steps_s)
    usual_s = float(np.median(steps_s))
    raise CsvImportError(
        f"{table.path}, line {table.lines[worst + 1]}: column {column} has an irregular step, "
        f"{steps_s[worst]:.6g} s, usually {usual_s:.6g} s: {_remedy(usual_s)}, or cut the file"
    )


def _refuse_emptiness(
    table: CsvTable, column: str, steps_s: FloatArray, periods: FloatArray
) -> None:
    if periods.sum() - len(periods) > len(table.lines):
        longest = int(np.argmax(periods))
        if longest == 0:
            raise CsvImportError(
                f"{table.path}, line {table.lines[0]}: column {column} has another time in its "
                "first row than in those below: take it out"
            )
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
    first = int(np.argmax(steps_s <= 0.0))
    times_s, line = table.values[:, 0], table.lines[first + 1]
    parts = "make a file of each part, and give them together"
    if first > 0 and times_s[first + 1] < times_s[1]:
        advice = "begins anew: make a file of each run, and give them together"
    elif first == 0 and np.all(steps_s[1:] > 0.0):
        advice, line = (
            "has another time in its first row than in those below: take it out",
            line - 1,
        )
    elif np.all(steps_s < 0.0):
        advice = "does not increase: sort the rows by it, as they run backwards"
    elif _FEW_JUMPS + _FEW_EQUAL * len(steps_s) < np.count_nonzero(steps_s == 0.0) < len(steps_s):
        even_hz = (len(steps_s) + 1) / float(np.ptp(times_s))
        advice = (
            f"has the same time in many rows: where they come in packets or times have too few "
            f"digits, give their rate ({even_hz:.3g} Hz on average) as --time 200Hz; where rows "
            "are doubled, keep one of each"
        )
    elif np.all(steps_s != 0.0) and np.count_nonzero(steps_s < 0.0) <= _FEW_JUMPS:
        advice = f"goes back by {-steps_s[first]:.4g} s, as a clock that was set: {parts}"
    else:
        advice = (
            "does not increase: sort the rows, keep one of those with the same time, or name the "
            "column of the time"
        )
    raise CsvImportError(f"{table.path}, line {line}: column {column} {advice}")


def _remedy(usual_s: float) -> str:
    rate_hz = float(f"{1.0 / usual_s:.3g}")
    return f"resample it by a map with rate_hz: {rate_hz:g} beside the time"
