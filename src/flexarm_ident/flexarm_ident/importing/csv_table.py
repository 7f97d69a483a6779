"""Numbers of a text table's columns, and the lines on which they stand."""

from __future__ import annotations

import csv
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import chain, islice
from textwrap import shorten
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.bounds import require_plain_file, shown
from flexarm_core.errors import FlexarmError, reason

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path
    from typing import TextIO

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.importing.csv_map import CsvMap

    Row = tuple[int, list[str]]
    _Numbers = tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]

# Of equally many the first one counts.
_SEPARATORS = ("\t", ",", ";")
# What programs write for a number that they lack; NaN is a number to Python.
_MISSING = frozenset({"", "na", "n/a", "null"})
# A line of a table has some hundred characters.
_LINE_CHARACTERS = 1 << 20
# So many characters of the names are shown.
_LONGEST = 500
_BLOCK_ROWS = 50_000


class CsvImportError(FlexarmError):
    """Contradiction between a CSV file and its map."""


@dataclass(frozen=True, eq=False)
class CsvTable:
    """Columns of a file.

    Attributes
    ----------
    path : Path
        The file.
    values : ndarray, (rows, columns)
        Numbers; NaN in an output that was not measured.
    lines : ndarray of int, (rows,)
        Line of each row in the file, the first being 1.
    places : ndarray of int, (rows,)
        Rows from the first to each, with those of empty cells between them.
    cut : tuple of str
        Lines at the ends that are left out, with the reason.
    """

    path: Path
    values: FloatArray
    lines: NDArray[np.int64]
    places: NDArray[np.int64]
    cut: tuple[str, ...] = ()


class _File(NamedTuple):
    """Open file behind its header: by lines, the first with its number, or by the rows in them."""

    header: list[str]
    separator: str
    first_line: int
    lines: Iterator[str]
    rows: Iterator[Row]


class _Column(NamedTuple):
    """Column to read, and what to do about a cell without a number; nothing where it may lack."""

    name: str
    place: int
    advice: str = ""


def read_table(path: Path, mapping: CsvMap) -> CsvTable:
    """Read the columns of a map: its time where there is one, inputs, outputs.

    The rows are those from the first to the last in which every output has been measured, as a
    record has nothing to tell of the state before. A row whose cells are all empty is a missing
    one.

    Raises
    ------
    CsvImportError
        If the file cannot be read, lacks a column, has fewer than 2 rows, or a cell without a
        finite number; outputs may lack some, not all. The message names file, line and column.
    BoundError
        If it is no plain file.
    """
    with _opened(path) as file:
        columns = _columns(file.header, mapping, path)
        found = _plain_numbers(file, columns)
    if found is None:
        # From the start again: a cell may need another look.
        with _opened(path) as file:
            found = _numbers(file, columns, path)
    values, lines, places = found
    if len(lines) < 2:  # noqa: PLR2004 - one sampling interval needs two rows
        raise CsvImportError(f"{path}: data rows: {len(lines)}; at least 2 are needed")
    for column, cells in zip(columns, values.T, strict=True):
        if np.isnan(cells).all():
            raise CsvImportError(f"{path}: column {column.name} has no number: leave it out")
    return _cut(CsvTable(path, values, lines, places), columns)


def _plain_numbers(file: _File, columns: Sequence[_Column]) -> _Numbers | None:
    """Return numbers, lines and places of the rows; None where a cell is not a finite number."""
    if file.separator != ",":
        return None
    blocks = []
    with suppress(ValueError):
        # Only one block is held as text.
        while block := list(islice(file.lines, _BLOCK_ROWS)):
            # An empty line is no row, and one with more cells than names needs another look.
            most = max(line.count(",") for line in block)
            if not all(map(str.strip, block)) or most >= len(file.header):
                return None
            numbers = np.loadtxt(
                block,
                delimiter=",",
                comments=None,
                usecols=[column.place for column in columns],
                ndmin=2,
            )
            if not np.isfinite(numbers).all():
                return None
            blocks.append(numbers)
        values = np.concatenate(blocks)
        places = np.arange(len(values))
        return values, file.first_line + places, places
    return None


def _numbers(file: _File, columns: Sequence[_Column], path: Path) -> _Numbers:
    """Return numbers, lines and places of the rows, of whatever a cell may hold."""
    blocks, lines, places, mark = [np.empty((0, len(columns)))], [], [], ""
    numbered = ((place, row) for place, row in enumerate(file.rows) if any(map(str.strip, row[1])))
    while taken := list(islice(numbered, _BLOCK_ROWS)):
        block = [row for _, row in taken]
        _refuse_more_cells(block, file, path)
        if file.separator != ",":
            mark = _decimal_mark(block, columns, path, mark)
        blocks.append(_to_numbers(block, columns, path, mark or "."))
        lines += [line for line, _ in block]
        places += [place for place, _ in taken]
    return np.concatenate(blocks), np.array(lines, np.int64), np.array(places, np.int64)


def _refuse_more_cells(rows: Sequence[Row], file: _File, path: Path) -> None:
    names = len(file.header)
    for line, row in rows:
        if any(map(str.strip, row[names:])):
            commas = " (decimal commas need ; between the cells)" if file.separator == "," else ""
            raise CsvImportError(
                f"{path}, line {line}: it has {len(row)} cells, and the first line names "
                f"{names}: give each column a name{commas}"
            )


def _cut(table: CsvTable, columns: Sequence[_Column]) -> CsvTable:
    known = ~np.isnan(table.values)
    firsts, lasts = known.argmax(axis=0), len(known) - 1 - known[::-1].argmax(axis=0)
    late, early = int(firsts.argmax()), int(lasts.argmin())
    first, last = int(firsts[late]), int(lasts[early])
    if last <= first:
        raise CsvImportError(
            f"{table.path}: {columns[early].name} ends before {columns[late].name} begins: leave "
            "one of them out"
        )
    cut = []
    if first > 0:
        cut.append(_left_out(table.lines[:first], f"{columns[late].name} has no value there yet"))
    if last < len(known) - 1:
        cut.append(
            _left_out(table.lines[last + 1 :], f"{columns[early].name} has no value any more")
        )
    rows = slice(first, last + 1)
    places = table.places[rows] - table.places[first]
    return CsvTable(table.path, table.values[rows], table.lines[rows], places, tuple(cut))


def _left_out(lines: NDArray[np.int64], why: str) -> str:
    which = f"line {lines[0]} is" if len(lines) == 1 else f"lines {lines[0]} to {lines[-1]} are"
    return f"{which} left out: {why}"


def column_names(path: Path) -> list[str]:
    """Return the names in the first line of a table.

    Raises
    ------
    CsvImportError
        If the file cannot be read, or names fewer than two columns.
    """
    with _opened(path) as file:
        header = file.header
        if len(header) < 2:  # noqa: PLR2004 - an input and an output
            there = f"names one column, {shown(header[0])}" if any(header) else "is empty"
            raise CsvImportError(
                f"{path}: the first line {there}: it has the names of the columns, with commas "
                "between them"
            )
        return header


@contextmanager
def _opened(path: Path) -> Iterator[_File]:
    """Open a table; its separator is the one that stands most often in the first line."""
    try:
        require_plain_file(path)
        # utf-8-sig: spreadsheets put a byte order mark in front of the first name.
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = _lines(file, path)
            first = next(lines, "")
            separator = max(_SEPARATORS, key=first.count)
            _refuse_numbers_alone(first, path)
            reader = csv.reader(chain([first], lines), delimiter=separator)
            header = [name.strip() for name in next(reader)]
            if len(header) == 1 and len(first.split()) > 1:
                raise CsvImportError(
                    f"{path}: its columns are separated by spaces: save it with commas between them"
                )
            # A line of blanks is no row: programs put some between the rows, or at the end.
            filled = (row for row in reader if len(row) > 1 or "".join(row).strip())
            rows = ((reader.line_num, row) for row in filled)
            yield _File(header, separator, reader.line_num + 1, lines, rows)
    except UnicodeDecodeError as error:
        raise CsvImportError(f"{path}: is no text in UTF-8: save it as CSV in UTF-8") from error
    except (OSError, csv.Error) as error:
        raise CsvImportError(f"{path}: cannot be read as CSV: {reason(error)}") from error


def _refuse_numbers_alone(first: str, path: Path) -> None:
    for separator in _SEPARATORS:
        cells = [cell.strip().replace(",", ".") for cell in first.split(separator)]
        # A data frame without names has the count of its columns for them.
        named = cells == [str(k) for k in range(len(cells))]
        if len(cells) > 1 and not named and all(map(_is_number, cells)):
            raise CsvImportError(
                f"{path}: the first line has numbers alone, {shown(first.strip())}: put a line "
                "with the names of the columns above it"
            )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _lines(file: TextIO, path: Path) -> Iterator[str]:
    while line := file.readline(_LINE_CHARACTERS):
        if len(line) == _LINE_CHARACTERS:
            raise CsvImportError(f"{path}: a line has {_LINE_CHARACTERS} characters or more")
        yield line


def _columns(header: Sequence[str], mapping: CsvMap, path: Path) -> list[_Column]:
    wanted = mapping.columns()
    if missing := [name or shown(name) for name in wanted if name not in header]:
        which = f"no column{'s' * (len(missing) > 1)} {', '.join(missing)}"
        raise CsvImportError(f"{path}: {which}; {_there(header)}")
    if doubled := [name for name in wanted if header.count(name) > 1]:
        raise CsvImportError(f"{path}: more than one column {doubled[0]}; {_there(header)}")
    # Where rows have no time, none can be left out.
    how = "empty all cells of the row" if mapping.time is None else "take the line out"
    otherwise = f", or {how}: that makes a hole"
    inputs = f"an input must be known in every row: fill it{otherwise}"
    times = f"a row needs its time: fill it{otherwise}"
    return [
        *(_Column(name, header.index(name), times) for name in (mapping.time,) if name),
        *(_Column(each.column, header.index(each.column), inputs) for each in mapping.inputs),
        *(_Column(each.column, header.index(each.column)) for each in mapping.outputs),
    ]


def _there(header: Sequence[str]) -> str:
    return f"there are: {shorten(', '.join(header), _LONGEST)}"


def _decimal_mark(rows: Sequence[Row], columns: Sequence[_Column], path: Path, known: str) -> str:
    """Return the decimal mark of the rows so far, comma or point; nothing where none has one."""
    for line, row in rows:
        for column in columns:
            cell = row[column.place] if column.place < len(row) else ""
            for mark in (each for each in ",." if each in cell):
                if known not in ("", mark):
                    raise CsvImportError(
                        f"{path}, line {line}, column {column.name}: {shown(cell)}, and the file "
                        "has commas and points in its numbers: write all with one of them, and "
                        "thousands without"
                    )
                known = mark
    return known


def _to_numbers(
    rows: Sequence[Row], columns: Sequence[_Column], path: Path, mark: str
) -> FloatArray:
    try:
        numbers = np.array(
            [[float(row[column.place].replace(mark, ".")) for column in columns] for _, row in rows]
        )
        if np.isfinite(numbers).all():
            return numbers
    except (ValueError, IndexError):
        pass
    return np.array(
        [
            [
                _number(row, column, mark, f"{path}, line {line}, column {column.name}")
                for column in columns
            ]
            for line, row in rows
        ]
    )


def _number(row: Sequence[str], column: _Column, mark: str, where: str) -> float:
    """Return the number in a cell, NaN where an output was not measured."""
    cell = row[column.place].strip() if column.place < len(row) else ""
    try:
        number = np.nan if cell.lower() in _MISSING else float(cell.replace(mark, "."))
    except ValueError as error:
        advice = "write it with a point" if "," in cell and mark != "," else "correct it"
        advice = "close its quotation marks" if "\n" in cell else advice
        raise CsvImportError(f"{where}: {shown(cell)} is not a number: {advice}") from error
    if np.isinf(number):
        advice = column.advice or "empty the cell where nothing was measured"
        raise CsvImportError(f"{where}: {cell} is not finite; {advice}")
    if np.isnan(number) and column.advice:
        problem = f"{cell} is no number" if cell else "empty cell"
        raise CsvImportError(f"{where}: {problem}; {column.advice}")
    return number
