"""Instants written as dates and times of the day."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from functools import lru_cache

_DATE = r"(?:(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|(\d{1,2})([./-])(\d{1,2})[./-](\d{4}))"
_TIME = r"(\d{1,2}):(\d{2})(?::(\d{2}))?(?:[.,](\d{1,9}))?\s*([AaPp][Mm])?"
_ZONE = r"\s*(?:Z|UTC|([+-])(\d{2}):?(\d{2}))?"
_CLOCK = re.compile(rf"(?:{_DATE}(?:[T ]+|$))?(?:{_TIME})?{_ZONE}")
_MONTHS = 12


def is_clock(text: str) -> bool:
    """Return whether a text is a date with a time, a date, or a time of the day."""
    return (
        bool(text)
        and (":" in text or text.count("-") + text.count("/") + text.count(".") > 1)
        and (_CLOCK.fullmatch(text.strip()) is not None)
    )


def clock_s(text: str) -> float:
    """Return the seconds of an instant since 1970, or since midnight where it has no date.

    Raises
    ------
    ValueError
        If it is none.
    """
    found = _CLOCK.fullmatch(text.strip())
    if not found or not found.lastindex:
        raise ValueError(text)
    year, month, day, first, mark, second, late_year, *rest = found.groups()
    hour, minute, whole, fraction, half, sign, zone_h, zone_min = rest
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
    return seconds + (_date_s(int(year), int(month), int(day)) if year else 0.0)


@lru_cache(maxsize=16)
def _date_s(year: int, month: int, day: int) -> float:
    return datetime(year, month, day, tzinfo=timezone.utc).timestamp()
