"""Cells of text tables: numbers and instants as programs write them, and what stands for none."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.bounds import shown
from flexarm_core.errors import FlexarmError
from flexarm_core.labels import counted
from flexarm_ident.records.signals import look

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray

    Row = tuple[int, list[str]]

# What programs write for a number that they lack; NaN is a number to Python.
MISSING = frozenset(
    {"", "-", "--", "?", "...", "na", "n/a", "null", "nil", "none", "missing", "<missing>"}
    | {"#n/a", "#na", "#div/0!", "#value!", "#num!", "#ref!", "1.#qnan", "-1.#ind", "ovf", "bad"}
    | {"#nv", "#n/v", "#wert!", "#zahl!", "#bezug!", "no data", "nodata", "*", "---", "--.--"}
)
# Names have a letter.
NAME = re.compile(r".*[^\W\d].*")
_GROUP_MARKS = "' \u00a0\u202f\u2019"
_NUMBER = re.compile(
    rf"[+-]?[0-9.,][0-9.,_{_GROUP_MARKS}]*([eEdD][+-]?[0-9]+)?|[+-]?(nan|inf(inity)?)",
    re.IGNORECASE,
)
_SPACED = re.compile(r"[+-]?[0-9]{1,3}(?: [0-9]{3})+(?:[.,][0-9]+)?")
THOUSANDS = {
    mark: re.compile(rf"([+-]?\d{{1,3}})((?:[{other}{_GROUP_MARKS}]\d{{3}})+)(\{mark}\d*)?")
    for mark, other in ((".", ","), (",", "."))
}
_GROUP = 3
_WITH_UNIT = re.compile(
    r"([+-]?[0-9.,]*[0-9](?:[eE][+-]?[0-9]+)?) ?"
    r"(%|\u00b0[CF]?|[a-zA-Z\u00b5\u03bc\u03a9]{1,4}(?:/[a-z\u00b2^2]+)?)"
)
# As NumPy and others print a number, and lists of one.
_PRINTED = re.compile(
    r"(?:(?:(?:np\.|numpy\.)?(?:float|u?int)\d*|tensor|array|Decimal)\(['\"\[]?|\[)"
    r"([^\s()\[\],'\"]+),?['\"]?\]?\)?"
)
_SEVERAL = re.compile(r"\[.*[, ].*\]")
_MINUS_BEHIND = re.compile(r"([0-9.,]*[0-9])-")
_ACCOUNTING = re.compile(r"\(([0-9.,]+)\)")
_CHECKSUM = re.compile(r"(?<=\d)\*[0-9A-F]{2}$")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]+")
_STATES = {"true": "1", "on": "1", "false": "0", "off": "0"}
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
_SHOWN = 5
# Counts of so many bits are written without their sign.
_SIGNED_BITS = (16, 32)
_FEWEST_NINES, _SMALLEST_POWER = 999.0, 1e10
# A signal of fewer levels is one of states, which may lie anywhere.
_FEW_LEVELS = 4


class CsvImportError(FlexarmError):
    """Contradiction between a CSV file and its map."""


def is_value(cell: str) -> bool:
    """Return whether a cell has a number or an instant, in whatever form."""
    text = bare(cell.strip())[0]
    if " " in text and not is_clock(text):
        return bool(_SPACED.fullmatch(text))
    return bool(_NUMBER.fullmatch(text)) or is_clock(text)


def is_word(cell: str) -> bool:
    """Return whether a cell has a word, or a sign of none and of infinity, where a number was."""
    return "#" in cell or "inf" in cell.lower() or not re.search(r"\d", cell)


def bare(cell: str) -> tuple[str, str]:
    """Return a number as Python and others write it, and the unit that stood behind it.

    Spreadsheets put an apostrophe before it and brackets for a minus, or the minus behind it,
    instruments a unit, receivers a checksum, and controllers write hexadecimal counts and states.
    """
    text = _CHECKSUM.sub("", cell.removeprefix("'"))
    if text[-1:].isdigit() and text[:2].lower() != "0x":
        return text, ""
    if found := _WITH_UNIT.fullmatch(text):
        return (text, "") if is_clock(text) else (found[1], found[2])
    if found := _ACCOUNTING.fullmatch(text) or _MINUS_BEHIND.fullmatch(text):
        return f"-{found[1]}", ""
    if (found := _PRINTED.fullmatch(text)) and _NUMBER.fullmatch(found[1]):
        return found[1], ""
    if _HEXADECIMAL.fullmatch(text):
        return str(int(text, 16)), ""
    return _STATES.get(text.lower(), text), ""


def decimal_mark(cell: str) -> tuple[str, bool]:
    """Return the decimal mark of a number, and whether it is sure to be one.

    That of thousands is before it, or comes twice. Alone before three digits, a mark is of either
    kind, and digits without one may be those of a number that is too small for it.
    """
    last = max(",.", key=cell.rfind)
    if last not in cell:
        return "", len(cell.strip("+-")) > _GROUP
    other = ",."[last == ","]
    is_grouped = THOUSANDS[other].fullmatch(cell) is not None
    if cell.count(last) > 1 and is_grouped:
        return other, True
    return last, not is_grouped or cell.lstrip("+-").startswith("0")


def number(cell: str, mark: str, *, is_time: bool = False) -> float:
    """Return the number in a cell without its unit, or the seconds of an instant.

    Raises
    ------
    ValueError
        If it is none.
    """
    if is_time and not cell.isdigit():
        with suppress(ValueError):
            return clock_s(cell)
    cell, _ = bare(cell.strip("()") if is_time and cell.startswith("(") else cell)
    if grouped := THOUSANDS[mark].fullmatch(cell):
        whole, thousands, fraction = grouped.groups("")
        cell = whole + re.sub(r"\D", "", thousands) + fraction
    # Fortran writes D for double precision.
    return float(re.sub(r"(?<=\d)[dD](?=[+-]?\d)", "e", cell.replace(mark, ".")))


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


class Column(NamedTuple):
    """Column to read, and what to do about a cell without a number; nothing where it may lack."""

    name: str
    place: int
    advice: str = ""
    is_time: bool = False
    unit: str = ""


@dataclass
class Rows:
    """Rows that were read so far, in blocks."""

    blocks: list[FloatArray]
    lines: list[NDArray[np.int64]]
    places: list[NDArray[np.int64]]
    words: list[int] = field(default_factory=list)
    short: list[int] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    # Words in the place of an output's numbers, and what is wrong with the first of them.
    words_of: dict[str, Counter[str]] = field(default_factory=dict)
    unread: dict[str, str] = field(default_factory=dict)
    # What is wrong with the first input or time that lacks.
    lacking: dict[str, str] = field(default_factory=dict)


def to_numbers(
    rows: Sequence[Row], columns: Sequence[Column], path: Path, mark: str, found: Rows
) -> FloatArray:
    """Return the numbers of rows, (rows, columns), NaN where there is none; `found` learns why."""
    # The other mark would be one of thousands, which needs another look.
    point = str.maketrans({",": "x", ".": "x"} | {mark: "."})
    with suppress(ValueError, IndexError):
        numbers = np.array(
            [[float(row[column.place].translate(point)) for column in columns] for _, row in rows]
        )
        if np.isfinite(numbers).all():
            return numbers
    return np.array(
        [
            [_number(row, column, mark, f"{path}, line {line}", found) for column in columns]
            for line, row in rows
        ]
    )


def _number(row: Sequence[str], column: Column, mark: str, where: str, found: Rows) -> float:
    """Return the number in a cell, NaN where nothing was measured."""
    cell = row[column.place].strip() if column.place < len(row) else ""
    where, complaint = f"{where}, column {column.name}", ""
    try:
        value = np.nan if cell.lower() in MISSING else _value(cell, column, mark)
    except ValueError:
        value = np.nan
        advice = "write it with a point" if "," in cell and mark != "," else "correct it"
        advice = "close its quotation marks" if "\n" in cell else advice
        advice = "give each of its numbers a column" if _SEVERAL.fullmatch(cell) else advice
        complaint = f"{where}: {shown(cell)} is not a number: {advice}"
    is_infinite = np.isinf(value)
    if is_infinite:
        value = np.nan
        advice = column.advice or "empty the cell where nothing was measured"
        complaint = f"{where}: {cell} is not finite; {advice}"
    if complaint and (column.advice or not (is_word(cell) or is_infinite)):
        raise CsvImportError(complaint)
    if complaint:
        found.words_of.setdefault(column.name, Counter())[cell] += 1
        found.unread.setdefault(column.name, complaint)
    if np.isnan(value) and column.advice:
        problem = f"{cell} is not a number" if cell else "empty cell"
        found.lacking.setdefault(column.name, f"{where}: {problem}; {column.advice}")
    return value


def _value(cell: str, column: Column, mark: str) -> float:
    if bare(cell)[1] != column.unit:
        raise ValueError(cell)
    return number(cell, mark, is_time=column.is_time)


def word_notes(found: Rows, rows: int) -> Iterator[str]:
    """Yield the words that outputs have in place of numbers; in half of the rows they are refused.

    Raises
    ------
    CsvImportError
        If they are.
    """
    for name, words in found.words_of.items():
        if 2 * words.total() >= rows:
            raise CsvImportError(found.unread[name])
        which = ", ".join(map(shown, list(words)[:_SHOWN]))
        complaint = f"column {name} has {which} in {counted(words.total(), 'row')}"
        yield f"{complaint}: taken as not measured"


def without_stand_ins(
    values: FloatArray, columns: Sequence[Column], path: Path
) -> tuple[FloatArray, list[str]]:
    """Return numbers of which those that stand for none are NaN, counts with their sign, and notes.

    Raises
    ------
    CsvImportError
        If an input has such numbers.
    """
    values, notes = values.copy(), []
    for column, cells in zip(columns, values.T, strict=True):
        if column.is_time:
            continue
        with np.errstate(over="ignore"):
            stand_ins = list(_stand_ins(cells))
        for off in stand_ins:
            complaint = (
                f"column {column.name} is {cells[off][0]:g} in {counted(int(off.sum()), 'row')}, "
                "far off all others"
            )
            if column.advice:
                raise CsvImportError(
                    f"{path}: {complaint}, as a number that stands for none; {column.advice}"
                )
            cells[off] = np.nan
            notes.append(f"{complaint}: taken as not measured")
        if turn := _unsigned(cells):
            cells[cells >= 0.5 * turn] -= turn
            notes.append(
                f"column {column.name} has counts of {round(np.log2(turn))} bits without their "
                "sign: those of the upper half are taken as negative"
            )
    return values, notes


def _stand_ins(cells: FloatArray) -> Iterator[BoolArray]:
    """Yield where a number that programs write for none stands far off the others, and again."""
    for extreme in (np.nanmax(cells), np.nanmin(cells)):
        if not _may_stand_for_none(abs(extreme)):
            continue
        off = cells == extreme
        others = cells[~off & np.isfinite(cells)]
        if (
            1 < np.count_nonzero(off) < len(others)
            and np.abs(others - extreme).min() > np.ptp(others)
            and len(np.unique(look(others))) > _FEW_LEVELS
        ):
            yield off


def _may_stand_for_none(size: float) -> bool:
    """Return whether a number has nines alone, or is a large power of ten."""
    if size >= _SMALLEST_POWER and size == float(f"1e{round(np.log10(size))}"):
        return True
    return size >= _FEWEST_NINES and set(f"{size:.0f}") == {"9"}


def _unsigned(cells: FloatArray) -> float:
    """Return the turn of counts that lie around zero and have no sign; 0 for others."""
    known = cells[np.isfinite(cells)]
    for turn in (2.0**bits for bits in _SIGNED_BITS):
        if not 0.75 * turn <= known.max(initial=0.0) < turn or known.min() < 0.0:
            continue
        halves = known[known >= 0.5 * turn], known[known < 0.5 * turn]
        if (
            np.all(known == np.rint(known))
            and min(len(np.unique(look(half))) for half in halves) > 1
            and halves[0].min() >= 0.75 * turn
            and halves[1].max() < 0.25 * turn
        ):
            return turn
    return 0.0
