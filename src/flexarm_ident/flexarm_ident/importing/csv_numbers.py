"""Numbers of a table's columns, what stands there for none, and counts without their sign."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.bounds import shown
from flexarm_core.labels import counted
from flexarm_ident.importing.csv_cells import MISSING, CsvImportError, bare, is_word, number
from flexarm_ident.records.signals import look

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray

    Row = tuple[int, list[str]]

_SHOWN = 5
# Counts of so many bits are written without their sign.
_SIGNED_BITS = (16, 32)
_FEWEST_NINES, _SMALLEST_POWER = 999.0, 1e10
# A signal of fewer levels is one of states, which may lie anywhere.
_FEW_LEVELS = 4


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
    with suppress(ValueError, IndexError):
        numbers = np.array(
            [[float(row[column.place].replace(mark, ".")) for column in columns] for _, row in rows]
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
