"""Instants written as dates and times of the day."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

_DATE = r"(?:(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|(\d{1,2})([./-])(\d{1,2})[./-](\d{4}|\d{2}))"
_TIME = r"(\d{1,2}):(\d{2})(?::(\d{2}))?(?:[.,](\d{1,9})|(?<=:\d\d):(\d{3}))?\s*([AaPp][Mm])?"
_ZONE = r"\s*(?:Z|UTC|([+-])(\d{2}):?(\d{2}))?"
_CLOCK = re.compile(rf"(?:{_DATE}(?:[T ]+|$))?(?:{_TIME})?{_ZONE}")
_MONTHS = 12
_NAMES = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_NAMED = re.compile(rf"(\d{{1,2}})[- ]({'|'.join(_NAMES)})[- ](\d{{4}})", re.IGNORECASE)
_DAYS = re.compile(r"(\d+) days? (?=\d)")
_DAY_S = 86400.0
# Years of two digits are of 1970 to 2069.
_FIRST_YEAR, _CENTURY = 70, 100
# Counters of 16 and 32 bits are what programs take their times from.
_COUNTERS, _FEW_STEPS = (2.0**16, 2.0**32), 5.0


def is_clock(text: str) -> bool:
    """Return whether a text is a date with a time, a date, or a time of the day."""
    return (
        bool(text)
        and (":" in text or text.count("-") + text.count("/") + text.count(".") > 1)
        and _CLOCK.fullmatch(_in_numbers(text)) is not None
    )


def clock_s(text: str) -> float:
    """Return the seconds of an instant since 1970, or since midnight where it has no date.

    Raises
    ------
    ValueError
        If it is none.
    """
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
    """Return an instant without its days, and with the number of a month that has its name."""
    named = _NAMED.sub(
        lambda at: f"{at[3]}-{_NAMES.index(at[2].lower()) + 1}-{at[1]}", text.strip()
    )
    return _DAYS.sub("", named, count=1)


def counted_on(ticks: FloatArray) -> FloatArray:
    """Return the times of a counter that began anew at 0 behind its last number."""
    whole = np.all(np.isfinite(ticks)) and np.all((ticks >= 0.0) & (ticks == np.rint(ticks)))
    if not whole or not len(ticks):
        return ticks
    steps = np.diff(ticks)
    back = steps < 0.0
    for turn in _COUNTERS:
        # What begins anew otherwise, as a second run does, is far from the end of a turn.
        turned = steps[back] + turn
        if len(turned) and turned.min() > 0.0 and turned.max() <= _FEW_STEPS * np.median(steps):
            return ticks + turn * np.concatenate([[0.0], np.cumsum(back)])
    return ticks


@lru_cache(maxsize=16)
def _date_s(year: int, month: int, day: int) -> float:
    return datetime(year, month, day, tzinfo=timezone.utc).timestamp()
