"""Cells of text tables: numbers as programs write them, with units, signs and words for none."""

from __future__ import annotations

import re
from contextlib import suppress

from flexarm_core.errors import FlexarmError
from flexarm_ident.importing.csv_clock import clock_s, is_clock

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
_WITH_UNIT = re.compile(
    r"([+-]?[0-9.,]*[0-9](?:[eE][+-]?[0-9]+)?) ?"
    r"(%|\u00b0[CF]?|[a-zA-Z\u00b5\u03bc\u03a9]{1,4}(?:/[a-z\u00b2^2]+)?)"
)
_ACCOUNTING = re.compile(r"\(([0-9.,]+)\)")
_CHECKSUM = re.compile(r"(?<=\d)\*[0-9A-F]{2}$")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]+")
_STATES = {"true": "1", "on": "1", "false": "0", "off": "0"}


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

    Spreadsheets put an apostrophe before it and brackets for a minus, instruments a unit behind it,
    receivers a checksum, and controllers write hexadecimal counts and states.
    """
    text = _CHECKSUM.sub("", cell.removeprefix("'"))
    if text[-1:].isdigit() and text[:2].lower() != "0x":
        return text, ""
    if found := _WITH_UNIT.fullmatch(text):
        return (text, "") if is_clock(text) else (found[1], found[2])
    if found := _ACCOUNTING.fullmatch(text):
        return f"-{found[1]}", ""
    if _HEXADECIMAL.fullmatch(text):
        return str(int(text, 16)), ""
    return _STATES.get(text.lower(), text), ""


def decimal_mark(cell: str) -> str:
    """Return the decimal mark of a number; that of thousands is before it, or comes twice."""
    if is_word(cell):
        return ""
    last = max(",.", key=cell.rfind)
    if last not in cell:
        return ""
    other = ",."[last == ","]
    return other if cell.count(last) > 1 and THOUSANDS[other].fullmatch(cell) else last


def number(cell: str, mark: str, *, is_time: bool) -> float:
    """Return the number in a cell without its unit, or the seconds of an instant.

    Raises
    ------
    ValueError
        If it is none.
    """
    if is_time and not cell.isdigit():
        with suppress(ValueError):
            return clock_s(cell)
    cell, _ = bare(cell.strip("()") if is_time else cell)
    if grouped := THOUSANDS[mark].fullmatch(cell):
        whole, thousands, fraction = grouped.groups("")
        cell = whole + re.sub(r"\D", "", thousands) + fraction
    # Fortran writes D for double precision.
    return float(re.sub(r"(?<=\d)[dD](?=[+-]?\d)", "e", cell.replace(mark, ".")))
