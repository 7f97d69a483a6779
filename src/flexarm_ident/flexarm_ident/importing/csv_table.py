"""Numbers of a text table's columns, and the lines on which they stand."""

from __future__ import annotations

import csv
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import islice
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.bounds import shown
from flexarm_core.errors import reason
from flexarm_core.labels import TIME_UNITS_S, counted
from flexarm_ident.importing.csv_cells import (
    NAME,
    Column,
    CsvImportError,
    Rows,
    bare,
    decimal_mark,
    in_seconds,
    is_clock,
    is_value,
    is_word,
    nanoseconds_of,
    to_numbers,
    without_stand_ins,
    word_notes,
)
from flexarm_ident.importing.csv_layout import Layout, is_comment, is_cut, read_layout
from flexarm_ident.importing.csv_text import lines_of, opened

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.importing.csv_cells import Row
    from flexarm_ident.importing.csv_map import CsvMap

# So many characters of the names, and so many lines, are shown.
_LONGEST, _SHOWN = 500, 5
_BLOCK_ROWS = 50_000
# Part of the rows that are short by accident.
_FEW = 0.01
_THOUSAND, _ROUNDING = 1e3, 1e-6


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
        Lines that are left out, with the reason.
    own_instants : bool
        Each column has its own rows, as in an export of several topics; NaN is not a sample.
    unit_given : bool
        Something gives the unit of the times, which are in s here; else it was taken for that.
    """

    path: Path
    values: FloatArray
    lines: NDArray[np.int64]
    places: NDArray[np.int64]
    cut: tuple[str, ...] = ()
    own_instants: bool = False
    unit_given: bool = True


def read_table(path: Path, mapping: CsvMap, layout: Layout | None = None) -> CsvTable:
    """Read the columns of a map: its time where there is one, inputs, outputs.

    The rows are those from the first to the last in which every output has been measured, as a
    record has nothing to tell of the state before. A row whose cells are all empty, or that has
    fewer cells than the others, is a missing one.

    Raises
    ------
    CsvImportError
        If the file cannot be read, lacks a column, has fewer than 2 rows, or a cell without a
        finite number; outputs may lack some, not all, and inputs where each column has rows of its
        own. The message names file, line and column.
    BoundError
        If it is not a plain file.
    """
    layout = layout or read_layout(path)
    if len(set(mapping.clocks)) > 1:
        return _joined(path, mapping, layout)
    columns = _columns(layout, mapping, path)
    ends_cut = is_cut(path, layout)
    with _lines(path, layout, ends_cut=ends_cut) as lines:
        found = _plain_numbers(lines, layout, columns)
    if found is None:
        # From the start again: a cell may need another look.
        with _lines(path, layout, ends_cut=ends_cut) as lines:
            found = _numbers(lines, layout, columns, path)
    if ends_cut:
        found.notes.append("the last line is cut off: left out")
    values, lines_read, places = _without_zeros(found, *_whole_rows(found), mapping)
    if len(values) < 2:  # noqa: PLR2004 - one sampling interval needs two rows
        raise CsvImportError(f"{path}: data rows: {len(values)}; at least 2 are needed")
    found.notes += word_notes(found, len(values))
    for column, cells in zip(columns, values.T, strict=True):
        if np.isnan(cells).all():
            rate = f"--time {layout.rate_hz or 200.0:g}Hz"
            advice = f"give the rate as {rate}" if column.is_time else "leave it out"
            raise CsvImportError(f"{path}: column {column.name} has no number: {advice}")
    values, notes = without_stand_ins(values, columns, path)
    found.notes += notes
    known = ~np.isnan(values)
    own_instants = mapping.time is not None and _have_own_rows(known[:, 1:], len(mapping.inputs))
    if found.lacking and not (own_instants and mapping.time not in found.lacking):
        raise CsvImportError(next(iter(found.lacking.values())))
    unit_given = True
    if mapping.time is not None:
        time, following = columns[:2]
        unit_s = TIME_UNITS_S[mapping.time_unit] if mapping.time_unit else layout.unit_s(time.name)
        cell = layout.cells[time.place] if time.place < len(layout.cells) else ""
        values, unit_s, is_turned = in_seconds(
            values, cell, unit_s, has_nanoseconds=following.is_time
        )
        unit_given = unit_s is not None
        if is_turned:
            found.notes.append(f"column {time.name} is a counter that begins anew: counted on")
    table = CsvTable(path, values, lines_read, places, _complaints(found), own_instants, unit_given)
    return table if own_instants else _cut(table, columns)


def _joined(path: Path, mapping: CsvMap, layout: Layout) -> CsvTable:
    """Read channels with times of their own: each has its rows, unless all times are the same."""
    channels = (*mapping.inputs, *mapping.outputs)
    of_clock = dict(zip(channels, mapping.clocks, strict=True))
    tables, places = [], []
    for clock in dict.fromkeys(mapping.clocks):
        inputs, outputs = (
            tuple(each for each in group if of_clock[each] == clock)
            for group in (mapping.inputs, mapping.outputs)
        )
        own = replace(mapping, inputs=inputs, outputs=outputs, time=clock, clocks=())
        tables.append(read_table(path, own, layout))
        places.append([0, *(1 + channels.index(each) for each in (*inputs, *outputs))])
    first = tables[0]
    same = all(np.array_equal(each.values[:, 0], first.values[:, 0]) for each in tables)
    ends = np.cumsum([0, *(0 if same else len(each.values) for each in tables)])
    values = np.full((max(ends[-1], len(first.values)), 1 + len(channels)), np.nan)
    for start, table, place in zip(ends, tables, places, strict=False):
        values[start : start + len(table.values), place] = table.values
    lines = first.lines if same else np.concatenate([each.lines for each in tables])
    order = np.argsort(values[:, 0], kind="stable")
    return CsvTable(
        path,
        values[order],
        lines[order],
        first.places if same else np.arange(len(order)),
        tuple(dict.fromkeys(note for each in tables for note in each.cut)),
        own_instants=not same,
        unit_given=all(each.unit_given for each in tables),
    )


@contextmanager
def _lines(path: Path, layout: Layout, *, ends_cut: bool) -> Iterator[Iterator[str]]:
    """Give the lines of a table from its first row on, without the last one where that is cut."""
    try:
        with opened(path, layout.encoding) as file:
            lines = islice(lines_of(file, path), layout.first_line - 1, None)
            yield (line for line in lines if line.endswith(("\n", "\r"))) if ends_cut else lines
    except (OSError, csv.Error) as error:
        raise CsvImportError(f"{path}: cannot be read as CSV: {reason(error)}") from error


def _without_zeros(
    found: Rows,
    values: FloatArray,
    lines: NDArray[np.int64],
    places: NDArray[np.int64],
    mapping: CsvMap,
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Return rows without those at the end whose time and signals are all 0, as never written."""
    written = np.flatnonzero(values.any(axis=1))
    if mapping.time is None or not len(written) or written[-1] == len(values) - 1:
        return values, lines, places
    used = slice(0, int(written[-1]) + 1)
    found.notes.append(_left_out(lines[used.stop :], "they have zeros alone, the time too"))
    return values[used], lines[used], places[used]


def _whole_rows(found: Rows) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers, lines and places without the few rows that are short.

    Where many are, the program leaves out empty cells at their ends.
    """
    values = np.concatenate(found.blocks)
    lines, places = np.concatenate(found.lines), np.concatenate(found.places)
    if len(found.short) > max(1, int(_FEW * len(lines))):
        found.short.clear()
    whole = ~np.isin(lines, found.short)
    return values[whole], lines[whole], places[whole]


def _have_own_rows(known: BoolArray, inputs: int) -> bool:
    """Return whether most samples of an output stand in rows that lack an input."""
    measured = known[:, inputs:].any(axis=1)
    return any(
        2 * np.count_nonzero(u & measured) < np.count_nonzero(measured) for u in known[:, :inputs].T
    )


def _plain_numbers(lines: Iterator[str], layout: Layout, columns: Sequence[Column]) -> Rows | None:
    """Return the rows; None where a line is not of as many plain numbers as the first one."""
    if layout.separator not in "\t,;|" or layout.width > len(layout.names):
        return None
    marks: set[str] = set()
    found = Rows([], [], [])
    with suppress(ValueError):
        # Only one block is held as text.
        while block := list(islice(lines, _BLOCK_ROWS)):
            # An empty line is not a row, and one of other cells than names needs another look.
            counts = {line.count(layout.separator) for line in block}
            if counts != {layout.width - 1} or not all(map(str.strip, block)):
                return None
            if layout.separator != ",":
                marks |= {mark for mark in ",." if any(mark in line for line in block)}
            if len(marks) > 1:
                return None
            numbers = np.loadtxt(
                [line.replace(",", ".") for line in block] if "," in marks else block,
                delimiter=layout.separator,
                comments=None,
                usecols=[column.place for column in columns],
                ndmin=2,
            )
            if not np.isfinite(numbers).all() or (marks and _may_be_grouped(numbers)):
                return None
            first = sum(map(len, found.places))
            found.blocks.append(numbers)
            found.places.append(np.arange(first, first + len(numbers)))
            found.lines.append(layout.first_line + found.places[-1])
        return found if found.blocks else None
    return None


def _numbers(lines: Iterator[str], layout: Layout, columns: Sequence[Column], path: Path) -> Rows:
    """Return the rows, of whatever a cell may hold."""
    none = np.empty(0, dtype=np.int64)
    found, mark = Rows([np.empty((0, len(columns)))], [none], [none]), ""
    numbered = _rows_of(lines, layout, columns, found, path)
    while taken := list(islice(numbered, _BLOCK_ROWS)):
        block = [row for _, row in taken]
        mark = _decimal_mark(block, columns, path, mark)
        found.blocks.append(to_numbers(block, columns, path, mark or ".", found))
        found.lines.append(np.array([line for line, _ in block], np.int64))
        found.places.append(np.array([place for place, _ in taken], np.int64))
    return found


def _rows_of(
    lines: Iterator[str], layout: Layout, columns: Sequence[Column], found: Rows, path: Path
) -> Iterator[tuple[int, Row]]:
    """Return the rows that have numbers, each with its place among those and empty ones."""
    place, names = -1, len(layout.names)
    times = [column.place for column in columns if column.is_time]
    wanted = [column.place for column in columns]
    # Those behind the last row are a footer, of which nobody needs to know.
    words: list[int] = []
    for line, row in layout.rows(lines, layout.first_line):
        cells = [cell.strip() for cell in row]
        if len(cells) < 2 and not "".join(cells):  # noqa: PLR2004 - programs put blank lines
            continue
        if any(cells) and (is_comment(cells) or _has_words_for(times, cells)):
            words.append(line)
            continue
        place += 1
        if any(cells) and len(cells) < layout.width:
            found.short.append(line)
        if any(cells[names:]):
            commas = " (decimal commas need ; between the cells)" if layout.separator == "," else ""
            raise CsvImportError(
                f"{path}, line {line}: it has {len(row)} cells, and the first line names "
                f"{names}: give each column a name{commas}"
            )
        if any(cells[at] for at in wanted if at < len(cells)):
            yield place, (line, cells)
            found.words += words
            words.clear()


def _has_words_for(times: Sequence[int], cells: Sequence[str]) -> bool:
    """Return whether a row has a word for its time, as `Maximum` below a table."""
    there = [cells[place] for place in times if place < len(cells)]
    return any(NAME.fullmatch(cell) and is_word(cell) for cell in there if not is_value(cell))


def _complaints(found: Rows) -> tuple[str, ...]:
    """Return the lines that are not rows."""
    notes = [*found.notes]
    if found.short:
        notes.append(
            f"{_lines_shown(found.short)} fewer cells than the others: left out as missing, as two "
            "cells may have run together"
        )
    if found.words:
        notes.append(f"{_lines_shown(found.words)} words in place of numbers: left out")
    return tuple(notes)


def _lines_shown(lines: Sequence[int]) -> str:
    shown_lines = ", ".join(map(str, lines[:_SHOWN])) + (", ..." if len(lines) > _SHOWN else "")
    if len(lines) == 1:
        return f"line {shown_lines} has"
    return f"{counted(len(lines), 'line')} ({shown_lines}) have"


def _cut(table: CsvTable, columns: Sequence[Column]) -> CsvTable:
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
    return replace(
        table,
        values=table.values[rows],
        lines=table.lines[rows],
        places=places,
        cut=(*cut, *table.cut),
    )


def _left_out(lines: NDArray[np.int64], why: str) -> str:
    which = f"line {lines[0]} is" if len(lines) == 1 else f"lines {lines[0]} to {lines[-1]} are"
    return f"{which} left out: {why}"


def column_names(path: Path) -> list[str]:
    """Return the names of the columns of a table.

    Raises
    ------
    CsvImportError
        If the file cannot be read, or has fewer than two columns.
    """
    return list(table_layout(path).names)


def table_layout(path: Path) -> Layout:
    """Return the layout of a table of two columns or more; errors as in `column_names`."""
    layout = read_layout(path)
    names = layout.names
    if len(names) < 2:  # noqa: PLR2004 - an input and an output
        there = f"names one column, {shown(names[0])}" if any(names) else "is empty"
        raise CsvImportError(
            f"{path}: the first line {there}: it has the names of the columns, with commas "
            "between them"
        )
    return layout


def _columns(layout: Layout, mapping: CsvMap, path: Path) -> list[Column]:
    header = layout.names
    wanted = mapping.columns()
    if doubled := [name for name in wanted if f"{name}#2" in header]:
        raise CsvImportError(f"{path}: more than one column {doubled[0]}; {columns_text(layout)}")
    if missing := [name or shown(name) for name in wanted if name not in header]:
        which = f"no column{'s' * (len(missing) > 1)} {', '.join(missing)}"
        raise CsvImportError(f"{path}: {which}; {columns_text(layout)}")
    # Where rows have no time, none can be left out.
    how = "empty all cells of the row" if mapping.time is None else "take the line out"
    otherwise = f", or {how}: that makes a hole"
    inputs = f"an input must be known in every row: fill it{otherwise}"
    times = f"a row needs its time: fill it{otherwise}"
    parts = (mapping.time, nanoseconds_of(mapping.time, header)) if mapping.time else ()

    def column(name: str, advice: str = "", *, is_time: bool = False) -> Column:
        return Column(name, header.index(name), advice, is_time, layout.unit_in_cells(name))

    return [
        *(column(name, times, is_time=True) for name in parts if name),
        *(column(each.column, inputs) for each in mapping.inputs),
        *(column(each.column) for each in mapping.outputs),
    ]


def columns_text(layout: Layout) -> str:
    """Return the columns that there are."""
    alone = (
        ""
        if layout.is_named
        else (
            "it has numbers alone: put a line with the names of the columns above it, or call them "
            "as they are counted; "
        )
    )
    if layout.encoding in {"cp1252", "latin-1"} and not "".join(layout.names).isascii():
        alone += "the text is not in UTF-8: save it so if its names look wrong; "
    return f"{alone}there are: {shorten(', '.join(layout.names), _LONGEST)}"


def _may_be_grouped(numbers: FloatArray) -> bool:
    """Return whether the mark in a column may be one of thousands: `998` stands by `1.001`."""
    whole = numbers == np.rint(numbers)
    sizes = np.abs(numbers)
    thousandths = np.abs(1e3 * sizes - np.rint(1e3 * sizes)) < _ROUNDING
    fits = (whole | (thousandths & (sizes >= 1.0))) & (sizes < _THOUSAND)
    return bool(np.any(fits.all(axis=0) & whole.any(axis=0) & ~whole.all(axis=0)))


def _decimal_mark(rows: Sequence[Row], columns: Sequence[Column], path: Path, known: str) -> str:
    """Return the decimal mark of the rows so far, comma or point; nothing where none has one.

    The mark in `1.001` is one of either kind: of thousands where other numbers tell so, or where
    the column has `998` beside it.
    """
    kinds: dict[str, set[tuple[str, bool]]] = {}
    for line, row in rows:
        for column in columns:
            cell = row[column.place] if column.place < len(row) else ""
            if is_word(cell) or (column.is_time and is_clock(cell)):
                continue
            mark, is_sure = decimal_mark(bare(cell)[0])
            kinds.setdefault(column.name, set()).add((mark, is_sure))
            if not (mark and is_sure):
                continue
            if known not in ("", mark):
                raise CsvImportError(
                    f"{path}, line {line}, column {column.name}: {shown(cell)}, and the file "
                    "has commas and points in its numbers: write all with one of them, and "
                    "thousands without"
                )
            known = mark
    if known or not (marks := {mark for each in kinds.values() for mark, _ in each} - {""}):
        return known
    mark = min(marks)
    return ",."[mark == ","] if {("", False), (mark, False)} in kinds.values() else mark
