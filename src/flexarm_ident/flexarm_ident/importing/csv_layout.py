"""Layout of a text table: encoding, separator, names, units, and the line of the first row.

Programs put words, units, blank lines and comments above the numbers, so the rows tell where they
are: they are the lines whose cells are numbers in the same columns.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from dataclasses import dataclass
from itertools import count, islice, takewhile
from typing import TYPE_CHECKING

from flexarm_core.errors import reason
from flexarm_core.labels import time_unit_s, unit_ending
from flexarm_ident.importing.csv_cells import (
    MISSING,
    NAME,
    CsvImportError,
    bare,
    decimal_mark,
    is_value,
    number,
)
from flexarm_ident.importing.csv_forms import other_form
from flexarm_ident.importing.csv_text import encoding_of, lines_of, opened, without_breaks

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

_TABLES = frozenset(
    {".csv", ".tsv", ".txt", ".dat", ".lvm", ".log", ".asc", ".prn", ".mat", ".h5", ".hdf5"}
    | {".parquet", ".feather", ".arrow", ".tdms", ".npy", ".npz", ".pkl", ".wav", ".ulg", ".rrd"}
    | {".jsonl", ".ndjson", ".mot", ".sto", ".tab"}
)
# Of equally good ones the first counts; a blank stands for white space of any length.
_SEPARATORS = ("\t", ",", ";", "|", " ")
_HEAD_LINES, _HEAD_ROWS = 400, 20
# Bytes at the end of a file that have its last rows, and how many of these are compared.
_TAIL, _LAST_ROWS = 1 << 14, 10
_HEAD_CHARACTERS = 1 << 20
_COMMENT = re.compile(r"\s*(#+|%+|//+)\s*")
_PAIR = re.compile(
    r"(?<![\w./\[\]])([A-Za-z_][\w./\[\]]*)[\"']?\s*[:=]\s*"
    r"([+-]?[0-9.]+(?:,[0-9]+)?(?:[eE][+-]?[0-9]+)?|nan)"
)
_ARROW = " -> "
# Instants before the words and numbers of a line: times of the day behind dates, seconds in square
# brackets as kernels and robots have them, and milliseconds in round ones behind a letter.
_STAMP = (
    r"((?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4},?[T ])?\d{1,2}:\d{2}:\d{2}(?:[.,]\d{1,9})?"
    r"|(?<=\[)[ ]*\d+\.\d+(?=\])|(?<=[EWID][ ]\()\d+(?=\)))"
)
_STAMPED = re.compile(_STAMP)
_BEFORE_ROW = re.compile(
    rf"(?:[^\d,;\t]*|[^\d,;\t]*[A-Za-z]{{3}} +\d{{1,2}} ){_STAMP}\S*(?: \d{{4}}\])? +"
    r"(?:(?![+-]?\.?\d)[^\s,]+ +)*(?!(?:19|20)\d\d[,;\t])(?=[+-]?\.?\d+[.,;\t](?!\d*[-:]))"
)
_UNIT = re.compile(
    r"[\[(].*[\])]||-|1|%|\u00b0[CF]?|[num\u00b5\u03bck]?(V|A|N|g|K|Pa|bar|m|Hz|W)|N ?m|cm|counts?|"
    r"sequence|ticks?|(deg|rad|m|V|mm)(/s(\^?2|\u00b2)?)?|rpm|degrees?|float(32|64)?|double|int(32|64)?|"
    r"(milli|micro|nano)?(second|volt|amp(ere)?|met(er|re)|newton|radian)s?",
    re.IGNORECASE,
)
_NAME_AND_UNIT = re.compile(r"\S+(?: +[\[(][^\])]*[\])])?")
_NUMBER = r"(\.?\d(?:[\d.,]*\d)?(?:[eE][+-]?\d+)?)"
_RATE = re.compile(
    rf"(?:sampl(?:e|ing)|abtast)[ _-]*(?:rate|freq\w*)\W+{_NUMBER}[ ]?([kM]?)(?:Hz|S/s|Sa/s)",
    re.IGNORECASE,
)
_INCREMENT = "Increment"
_PREFIXES = {"": 1.0, "k": 1e3, "m": 1e6}
_INTERVAL = re.compile(
    r"(?:sampl(?:e|ing)[ _]?(?:interval|period|time)|delta_x|tinc)(?:\W+(ms|us|s)\b)?"
    rf"[^\d\n]*?{_NUMBER}(?:[ ]?(ms|us|s)\b)?",
    re.IGNORECASE,
)
_TIME_NAME = re.compile(r"[\W_]*(t|time|time ?stamp|zeit|x_value)([\W_].*)?", re.IGNORECASE)
_TIME = "time"


@dataclass(frozen=True)
class Layout:
    """Where the numbers of a file are.

    Attributes
    ----------
    encoding : str
        Encoding of the text.
    separator : str
        Character between the cells; a blank for white space, ``=`` for ``name: value`` pairs.
    names : tuple of str
        Names of the columns, each once; ``column_1`` and so on where no line has them.
    units : tuple of str
        Units of a line below the names; empty without one.
    first_line : int
        Line of the first row, the first being 1.
    cells : tuple of str
        The first row.
    width : int
        Number of cells that most rows have.
    is_named : bool
        Whether a line names the columns.
    rate_hz : float
        Sampling rate that a line above the rows says, Hz; 0 without one.
    """

    encoding: str
    separator: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    first_line: int
    cells: tuple[str, ...]
    width: int
    is_named: bool
    rate_hz: float = 0.0

    def unit(self, name: str) -> str:
        """Return the unit of a column that the line below the names or its cells give."""
        units = dict(zip(self.names, self.units, strict=False))
        return units.get(name) or self.unit_in_cells(name)

    def unit_in_cells(self, name: str) -> str:
        """Return the unit that stands behind the numbers of a column; else empty."""
        return bare(dict(zip(self.names, self.cells, strict=False)).get(name, ""))[1]

    def unit_s(self, name: str) -> float | None:
        """Return the unit of time that a column's name or the line below gives, s."""
        unit = self.unit(name).strip("()[] ")
        inside = (f"t [{each}]" for each in re.findall(r"[\[(](\w+)[\])]", name))
        # A column of a counter may have its unit for a name, as micros.
        unique = (name, f"t [{unit}]" if unit else "", f"t [{name}]", *inside)
        return next(filter(None, map(time_unit_s, unique)), None)

    def rows(self, lines: Iterable[str], first: int) -> Iterator[tuple[int, list[str]]]:
        """Return the cells of lines with the number of each, the first of them being given."""
        if self.separator in "= ":
            for number, line in enumerate(lines, first):
                yield number, _split(line, self.separator, self.names)
            return
        plain = (_in_cells(line, self.separator) for line in lines)
        reader = csv.reader(plain, delimiter=self.separator, skipinitialspace=True)
        for row in reader:
            yield first + reader.line_num - 1, row


def is_table(path: Path) -> bool:
    """Return whether a path is that of a table by its ending: no bag is called so."""
    return path.suffix.lower() in _TABLES


def read_layout(path: Path) -> Layout:
    """Find the table in a file.

    Raises
    ------
    CsvImportError
        If the file cannot be read or is not a text; the message says what it is and what to do.
    BoundError
        If it is not a plain file.
    """
    encoding = encoding_of(path)
    with opened(path, encoding) as file:
        head: list[str] = []
        size = 0
        for line in islice(lines_of(file, path), _HEAD_LINES):
            head.append(line)
            size += len(line)
            if size > _HEAD_CHARACTERS:
                break
    head = without_breaks(head)
    try:
        layout = _layout(head, encoding)
    except csv.Error as error:
        raise CsvImportError(f"{path}: cannot be read as CSV: {reason(error)}") from error
    rows = (_split(line, layout.separator, layout.names) for line in head[layout.first_line - 1 :])
    of_width = [cells for cells in rows if len(cells) == layout.width]
    if remedy := other_form(head, layout.names, of_width):
        raise CsvImportError(f"{path}: {remedy}")
    return layout


def is_cut(path: Path, layout: Layout) -> bool:
    """Return whether the last row has no end of line, and fewer cells or digits than those before.

    Programs that are stopped while they write leave such a row; its number may be a wrong one.
    """
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _TAIL))
        tail = file.read().rstrip(b"\0")
    if layout.encoding.startswith("utf-16") or tail.endswith((b"\n", b"\r")):
        return False
    lines = tail.decode(layout.encoding, "replace").splitlines()[1:]
    rows = [cells for _, cells in layout.rows(lines, 1)][-_LAST_ROWS:]
    if len(rows) < _LAST_ROWS or not is_value(rows[-1][0]):
        return False
    widths = {len(row) for row in rows[:-1]}
    digits = {_digits(row) for row in rows[:-1]}
    last = rows[-1]
    return widths == {layout.width} and (
        len(last) < layout.width or (len(digits) == 1 and _digits(last) < min(digits))
    )


def _digits(row: Sequence[str]) -> int:
    """Return the digits behind the decimal mark of a row's last number."""
    return len(re.split("[.,]", row[-1].strip())[-1])


def is_comment(cells: Sequence[str]) -> bool:
    """Return whether a row is a comment, a blank line or words between rows."""
    has_values = any(is_value(cell) or cell.lower() in MISSING - {""} for cell in reversed(cells))
    return bool(cells and _COMMENT.match(cells[0])) or not has_values


def _split(line: str, separator: str, names: Sequence[str] = ()) -> list[str]:
    if separator == "=":
        pairs = dict(_PAIR.findall(line))
        if tuple(names[:1]) == (_TIME,):
            pairs.setdefault(_TIME, _stamp(line))
        return [pairs.get(name, "") for name in names] if pairs else [line.strip()]
    if separator == " ":
        text = line.replace(_ARROW, " ")
        if '"' not in text:
            return text.split()
        return next(csv.reader([text.strip()], delimiter=" ", skipinitialspace=True), [])
    text = _in_cells(line, separator)
    if separator not in text:
        return [text.strip()] if text else []
    return next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])


def _in_cells(line: str, separator: str) -> str:
    """Return a line whose instant before the numbers has a cell of its own."""
    if separator != "|" and (stamped := _BEFORE_ROW.match(line)):
        return f"{_instant(stamped[1])}{separator}{line[stamped.end() :]}"
    return line.replace(_ARROW, separator, 1)


def _stamp(line: str) -> str:
    """Return the instant before the first value that a line names; empty without one."""
    stamped, first = _STAMPED.search(line), _PAIR.search(line)
    return _instant(stamped[1]) if stamped and first and stamped.end() <= first.start() else ""


def _instant(stamp: str) -> str:
    if stamp.isdigit():
        return f"{1e-3 * int(stamp):.3f}"
    return stamp.strip().replace(", ", " ").replace(",", ".")


def _layout(head: Sequence[str], encoding: str) -> Layout:
    if keyed := _keyed(head, encoding):
        return keyed
    found = {separator: _rows(head, separator) for separator in _SEPARATORS}
    separator = max(_SEPARATORS, key=lambda each: found[each][0])
    _, width, rows = found[separator]
    if not rows:
        return _header_alone(head, encoding)
    usual = _split(head[rows[-1]], separator)
    table = {k: _split(head[k], separator) for k in rows}
    first = next(
        k for k in rows if not (_has_own_units(table[k], usual) or _is_of_head(table, k, usual))
    )
    cells = table[first]
    counted = [cell.strip() for cell in cells] == [str(k) for k in range(len(cells))]
    above = [*range(first)]
    names, units = _named(head, above, separator, width - _empty_ends(head, rows, separator))
    if not names and counted and not any(map(str.strip, head[:first])):
        # A data frame without names has the count of its columns for them.
        names, first = [cell.strip() for cell in cells], first + 1
        cells = _split(head[first], separator) if first < len(head) else []
    names = names or _named_beside([table[k] for k in rows], width)
    is_named = bool(names)
    is_stamped = separator != " " and _BEFORE_ROW.match(head[first]) is not None
    if not names:
        names = [f"column_{k + 1}" for k in range(width)]
        # As `ros2 topic echo --csv` writes messages with a header.
        if width > 2 and re.fullmatch(r"\d{9,10}", cells[0]) and re.fullmatch(r"\d{1,9}", cells[1]):  # noqa: PLR2004
            names[:2] = ["sec", "nanosec"]
    if is_stamped and (not is_named or not names[0]):
        names[0] = _TIME
    return Layout(
        encoding,
        separator,
        tuple(_once(names)),
        tuple(units),
        first + 1,
        tuple(cell.strip() for cell in cells),
        width,
        is_named,
        _rate_hz(head[:first], separator),
    )


def _named_beside(rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Return names from words beside the rows, as oscilloscopes of Tektronix have them.

    A channel has the cells `Source, CH1, , TIME, VALUE` in one of its first rows.
    """
    names = [f"column_{k + 1}" for k in range(width)]
    found = False
    for cells in rows[:_HEAD_ROWS]:
        for k, key in enumerate(cells[:-4]):
            if key.strip() == "Source" and is_value(cells[k + 4]):
                names[k + 3 : k + 5] = _TIME, cells[k + 1].strip()
                found = True
    return names if found else []


def _rate_hz(above: Sequence[str], separator: str) -> float:
    """Return the rate that lines above the rows say, Hz; 0 without one."""
    table = [_split(line, separator) for line in above]
    for cells, below in zip(table, [*table[1:], []], strict=False):
        line = (" " if separator == " " else "\t").join(cells)
        if found := _RATE.search(line):
            return number(found[1], decimal_mark(found[1])[0] or ".") * _PREFIXES[found[2].lower()]
        step, unit = "", "s"
        if found := _INTERVAL.search(line):
            step, unit = found[2], found[1] or found[3] or unit
        elif _INCREMENT in cells:
            # Oscilloscopes of Rigol have it below its name.
            step = dict(zip(cells, below, strict=False)).get(_INCREMENT, "")
        if is_value(step) and (ticks := number(step, decimal_mark(step)[0] or ".")) > 0.0:
            return float(f"{1.0 / (ticks * (time_unit_s(f't [{unit}]') or 1.0)):.6g}")
    return 0.0


def _keyed(head: Sequence[str], encoding: str) -> Layout | None:
    """Return the layout of lines that name each value, as ``u:1.2 y:3.4``."""
    found = [[name for name, _ in _PAIR.findall(line)] for line in head]
    usual, times = Counter(tuple(names) for names in found).most_common(1)[0] if head else ((), 0)
    if len(usual) < 2 or 2 * times < len(head):  # noqa: PLR2004 - an input and an output
        return None
    first = found.index(list(usual))
    if _stamp(head[first]) and not any(map(_TIME_NAME.fullmatch, usual)):
        usual = (_TIME, *usual)
    cells = _split(head[first], "=", usual)
    return Layout(
        encoding, "=", tuple(_once(usual)), (), first + 1, tuple(cells), len(usual), is_named=True
    )


def _rows(head: Sequence[str], separator: str) -> tuple[int, int, list[int]]:
    """Return how well a separator fits, the usual number of cells, and the lines of rows."""
    table = [_split(line, separator) for line in head]
    kinds = [[is_value(cell) for cell in cells] for cells in table]
    widths: Counter[int] = Counter()
    for cells, values in zip(table, kinds, strict=True):
        if len(cells) > 1 and sum(values) > 0 and not _COMMENT.match(cells[0]):
            # Cells of words count against a separator, empty ones do not.
            widths[len(cells)] += 2 * sum(values) - sum(map(bool, map(str.strip, cells)))
    if not widths:
        return 0, 0, []
    width, score = max(widths.items(), key=lambda each: (each[1], each[0]))
    of_width = [k for k, cells in enumerate(table) if len(cells) == width]
    numeric = [
        2 * sum(kinds[k][c] for k in of_width) > sum(bool(table[k][c].strip()) for k in of_width)
        for c in range(width)
    ]

    def is_row(k: int) -> bool:
        good = [
            value or cell.strip().lower() in MISSING
            for value, cell, is_numeric in zip(kinds[k], table[k], numeric, strict=True)
            if is_numeric
        ]
        return 2 * sum(good) > len(good) and any(kinds[k]) and good[:1] != [False]

    return score, width, [k for k in of_width if is_row(k) and not _COMMENT.match(table[k][0])]


def _named(
    head: Sequence[str], above: Sequence[int], separator: str, width: int
) -> tuple[list[str], list[str]]:
    """Return the names in the lines above the rows, and the units between them."""
    units: list[str] = []
    named: tuple[list[str], list[str]] | None = None
    fallback: list[str] = []
    for k in reversed(above):
        cells = _header_cells(head[k], separator, width)
        if not any(cells) or all(bare(cell)[1] for cell in cells):
            # Some have the rates of the channels, as `200 Hz`, between names and rows.
            continue
        if len(cells) >= width and not units and _are_units(cells[:width]):
            units = cells[:width]
        elif len(cells) >= width and any(map(NAME.fullmatch, cells)):
            # Programs put lines of types and ways between the names and the rows. Beside a time
            # there are an input and an output.
            times = sum(map(bool, map(_TIME_NAME.fullmatch, cells)))
            if 0 < times < max(2, len(cells) - 1) and not any(map(is_value, cells)):
                return cells, units
            if named is None or _says_more(cells, named[0]):
                named = cells, units
        elif len(cells) == width - 1 and len(cells) > 1 and not (named or units):
            # Names of rows have no name themselves.
            return ["", *cells], units
        elif len(cells) > 1 and not fallback and all(map(NAME.fullmatch, cells)):
            fallback = cells
    return named or ((units or fallback), [])


def _has_own_units(cells: Sequence[str], usual: Sequence[str]) -> bool:
    """Return whether a line has units behind numbers where a usual row has none."""
    return any(bare(a)[1] and not bare(b)[1] for a, b in zip(cells, usual, strict=True))


def _is_of_head(table: Mapping[int, Sequence[str]], first: int, usual: Sequence[str]) -> bool:
    """Return whether lines have words where rows are empty, down to a line of another kind."""
    block = (table[k][0] for k in takewhile(table.__contains__, count(first)))
    return not usual[0].strip() and all(map(NAME.fullmatch, block))


def _says_more(cells: Sequence[str], named: Sequence[str]) -> bool:
    """Return whether a line has more different words than names that come again and again."""
    return len(set(cells)) > len(set(named)) and not any(map(is_value, cells))


def _empty_ends(head: Sequence[str], rows: Sequence[int], separator: str) -> int:
    """Return how many cells at the ends of rows are always empty."""
    filled = max(len(_filled(_split(head[k], separator))) for k in rows)
    return len(_split(head[rows[0]], separator)) - filled


def _filled(cells: list[str]) -> list[str]:
    """Return cells without the empty ones at the end."""
    last = max((k for k, cell in enumerate(cells) if cell.strip()), default=-1)
    return cells[: last + 1]


def _header_cells(line: str, separator: str, width: int) -> list[str]:
    """Return the names in a line, which has a separator of its own where it is a comment."""
    mark = _COMMENT.match(line)
    text = line[mark.end() :] if mark else line
    splits = [
        _split(text, each) for each in (separator, *(_SEPARATORS if mark else _SEPARATORS[:4]))
    ]
    if separator == " ":
        splits.append(_NAME_AND_UNIT.findall(text))
    fits = [cells for cells in splits if len(cells) == width]
    found = [cell.strip() for cell in (fits or splits)[0]]
    # A comment of other lengths is a sentence.
    return [] if mark and len(_filled(found)) not in (width - 1, width) else found


def _are_units(cells: Sequence[str]) -> bool:
    return all(
        _UNIT.fullmatch(cell) or unit_ending(cell) or time_unit_s(f"t [{cell}]") for cell in cells
    )


def _header_alone(head: Sequence[str], encoding: str) -> Layout:
    """Return the layout of a file without rows."""
    line = next((k for k, each in enumerate(head) if each.strip()), 0)
    text = head[line] if head else ""
    separator = max(_SEPARATORS[:4], key=text.count)
    names = [cell.strip() for cell in _split(text, separator)]
    return Layout(
        encoding, separator, tuple(_once(names)), (), line + 2, (), len(names), is_named=True
    )


def _once(names: Sequence[str]) -> list[str]:
    """Return names, those that come twice with their number."""
    times, seen = Counter(names), Counter[str]()
    unique = []
    for name in names:
        seen[name] += 1
        unique.append(f"{name}#{seen[name]}" if name and times[name] > 1 else name)
    return unique
