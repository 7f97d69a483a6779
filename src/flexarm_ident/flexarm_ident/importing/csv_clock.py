"""Instants written as dates and times of the day."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray

_DATE = r"(?:(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|(\d{1,2})([./-])(\d{1,2})[./-](\d{4}|\d{2}))"
_TIME = r"(\d{1,2}):(\d{2})(?::(\d{2}))?(?:[.,;](\d{1,9})|(?<=:\d\d):(\d{3}))?\s*([AaPp][Mm])?"
_ZONE = r"\s*(?:Z|UTC|([+-])(\d{2}):?(\d{2}))?"
_CLOCK = re.compile(rf"(?:{_DATE}(?:[T ]+|$))?(?:{_TIME})?{_ZONE}")
_MONTHS = 12
_NAMES = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_NAMED = re.compile(rf"(\d{{1,2}})[- ]({'|'.join(_NAMES)})[- ](\d{{4}})", re.IGNORECASE)
# The basic form of ISO 8601.
_COMPACT = re.compile(r"^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)(?!\d)")
# As MATLAB writes durations.
_DURATION = re.compile(r"([+-]?[\d.]+(?:e[+-]?\d+)?) (sec|min|hr|day)s?")
_DURATION_S = {"sec": 1.0, "min": 60.0, "hr": 3600.0, "day": 86400.0}
_DAYS = re.compile(r"(\d+) days? (?=\d)")
_DAY_S = 86400.0
# Years of two digits are of 1970 to 2069.
_FIRST_YEAR, _CENTURY = 70, 100
# Counters of 16 to 32 bits are what programs take their times from, and parts of a second or a
# minute, which begin anew three times or more.
_COUNTERS, _FEW_STEPS = (2.0**16, 2.0**24, 2.0**32), 5.0
_PARTS, _FEWEST_TURNS = (1.0, 1e3, 1e6, 1e9, 60.0, 6e4), 3

_HALF_A_DAY_S = 43200.0
# Stamps since 1970 are of the years 2001 to 2128.
_EARLIEST_S, _LATEST_S = 1e9, 5e9


def is_clock(text: str) -> bool:
    """Return whether a text is a date with a time, a date, a time of the day, or a duration."""
    return _DURATION.fullmatch(text) is not None or (
        bool(text)
        and (":" in text or "T" in text or text.count("-") + text.count("/") + text.count(".") > 1)
        and _CLOCK.fullmatch(_in_numbers(text)) is not None
    )


def clock_s(text: str) -> float:
    """Return the seconds of a duration, an instant since 1970, or since midnight without a date.

    Raises
    ------
    ValueError
        If it is none.
    """
    if duration := _DURATION.fullmatch(text):
        return float(duration[1]) * _DURATION_S[duration[2]]
    days = _DAYS.match(text.strip())
    found = _CLOCK.fullmatch(_in_numbers(text))
    if not found or not found.lastindex:
        raise ValueError(text)
    year, month, day, first, mark, second, late_year, *rest = found.groups()
    hour, minute, whole, fraction, thousandths, half, sign, zone_h, zone_min = rest
    fraction = fraction or thousandths
    if fraction and not whole:
        # Spreadsheets show 1 min 2.5 s as 01:02.5.
        hour, minute, whole = "0", hour, minute
    hours = int(hour or 0)
    if half:
        hours = hours % 12 + 12 * (half.lower() == "pm")
    seconds = 3600.0 * hours + 60.0 * int(minute or 0) + int(whole or 0)
    seconds += float(f"0.{fraction}") if fraction else 0.0
    if zone_h:
        seconds -= (1 if sign == "+" else -1) * (3600.0 * int(zone_h) + 60.0 * int(zone_min))
    if late_year:
        # Day before month, but with a slash as in America where that is possible.
        order = (second, first) if mark == "/" and int(first) <= _MONTHS else (first, second)
        year, (day, month) = late_year, order
        if int(year) < _CENTURY:
            year = f"{'19' if int(year) >= _FIRST_YEAR else '20'}{year}"
    seconds += _DAY_S * int(days[1]) if days else 0.0
    return seconds + (_date_s(int(year), int(month), int(day)) if year else 0.0)


def _in_numbers(text: str) -> str:
    """Return an instant without its days, with marks, and numbers for the names of months."""
    named = _NAMED.sub(
        lambda at: f"{at[3]}-{_NAMES.index(at[2].lower()) + 1}-{at[1]}", text.strip()
    )
    named = _COMPACT.sub(r"\1-\2-\3T\4:\5:\6", named)
    return _DAYS.sub("", named, count=1)


def nanoseconds_of(seconds: str, names: Sequence[str]) -> str:
    """Return the column of the nanoseconds that belong to whole seconds; empty without one."""
    stem = re.sub(r"secs?$", "", seconds)
    others = (f"{stem}{word}" for word in ("nanosec", "nsec", "nsecs", "nanosecs"))
    return next((other for other in others if stem != seconds and other in names), "")


def counted_on(ticks: FloatArray) -> FloatArray:
    """Return the times of a counter that began anew at its least number behind its last one."""
    if not len(ticks) or not np.all(np.isfinite(ticks)):
        return ticks
    steps = np.diff(ticks)
    back = steps < 0.0
    are_counts = np.all(ticks == np.rint(ticks))
    turns = [*(_COUNTERS if are_counts else ())]
    # Runs begin at one instant each, and a clock is read from anywhere on.
    if np.count_nonzero(back) >= _FEWEST_TURNS and ticks[0] > ticks[1:][back].max() + steps.max():
        turns += _PARTS
    for turn in turns:
        # What begins anew otherwise, as a second run does, is far from the end of a turn.
        turned = steps[back] + turn
        if len(turned) and turned.min() > 0.0 and turned.max() <= _FEW_STEPS * np.median(steps):
            return np.asarray(ticks + turn * np.concatenate([[0.0], np.cumsum(back)]))
    return ticks


def in_seconds(
    values: FloatArray, cell: str, unit_s: float | None, *, has_nanoseconds: bool
) -> tuple[FloatArray, float | None, bool]:
    """Return rows whose time is in s, its unit or None, and whether it is a counter that turned.

    Parameters
    ----------
    values : ndarray, (rows, columns)
        Numbers, those of the time before the others.
    cell : str
        Time of the first row as it stands in the file.
    unit_s : float or None
        Unit that something gives; None: ticks since 1970 give theirs.
    has_nanoseconds : bool
        The second column has the nanoseconds of the time.
    """
    is_turned = False
    seconds, *rest = values.T
    if has_nanoseconds:
        seconds, rest = seconds + rest[0] * 1e-9, rest[1:]
    if is_clock(cell) or has_nanoseconds:
        unit_s = 1.0
        days = np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -_HALF_A_DAY_S)
        # A time of the day begins anew at midnight.
        seconds = seconds + (
            2.0 * _HALF_A_DAY_S * days if seconds.max() < 2.0 * _HALF_A_DAY_S else 0.0
        )
    else:
        ticks, seconds = seconds, counted_on(seconds)
        is_turned = not np.array_equal(ticks, seconds, equal_nan=True)
    if unit_s is None:
        usual = float(np.nanmedian(np.abs(seconds)))
        since_1970_s = [(unit, usual * unit) for unit in (1e-3, 1e-6, 1e-9)]
        unit_s = next((unit for unit, s in since_1970_s if _EARLIEST_S <= s <= _LATEST_S), None)
    return np.column_stack([seconds * (unit_s or 1.0), *rest]), unit_s, is_turned


@lru_cache(maxsize=16)
def _date_s(year: int, month: int, day: int) -> float:
    return datetime(year, month, day, tzinfo=timezone.utc).timestamp()
