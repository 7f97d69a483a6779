"""Map of a CSV file from the names of its columns alone, where nobody wrote one."""

from __future__ import annotations

import re
from bisect import bisect
from contextlib import suppress
from dataclasses import dataclass, replace
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import TIME_UNIT_ENDING, TIME_UNITS_S, named_twice, time_unit_s
from flexarm_ident.importing.csv_cells import CsvImportError, is_clock, nanoseconds_of
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from flexarm_ident.importing.csv_table import columns_text, read_table, table_layout

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_ident.importing.csv_layout import Layout

_TIME = re.compile(
    r"_*(t|(rel_|elapsed )?time|time ?_?stamp|date ?_?time|elapsed|seconds?|ms|us|ns|millis|micros|"
    rf"zeit|x_value|(.*[._/])?secs?)({TIME_UNIT_ENDING})?(#\d+)?",
    re.IGNORECASE,
)
_HAS_TIME = re.compile(
    r"(.*[\W_])?(time|zeit|temps|tiempo|tempo|tijd|tid|czas|\u010das|\u0432\u0440\u0435\u043c\u044f"
    r"|\u65f6\u95f4|\u6642\u9593)([\W_].*)?",
    re.IGNORECASE,
)
_FREQUENCY = re.compile(r"f|freq(s|uency|uenz)?|fr\u00e9quence", re.IGNORECASE)
_CLOCK = re.compile(r"(.*[\W_])?(t|time|zeit|stamp|timestamp)(\d*|[\W_].*)", re.IGNORECASE)
_COMMAND = re.compile(
    r"(u|tau|torque|command|cmd|effort|force|current|voltage|input|control|drive|motor|pwm)"
    r"([ _.-]*(cmd|command|in|nm|n|v|a))?[ _.-]*\d*([ _.-]*(cmd|command|nm|n|v|a))?",
    re.IGNORECASE,
)
_WHOLE_SECONDS = re.compile(r"(.*[._/])?secs?", re.IGNORECASE)
_RATE = re.compile(r"([0-9.eE+-]+) ?Hz", re.IGNORECASE)
_ENDING = re.compile(r"\s*(\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))$")
_LONGEST = 300
# Clocks of two devices differ by less.
_SAME_RATE = 0.01


@dataclass(frozen=True)
class TableColumns:
    """Columns of tables that are inputs and outputs, by their names alone.

    Attributes
    ----------
    inputs, outputs : tuple of str
        Columns, each as ``COLUMN`` or ``NAME=COLUMN``; the unit in brackets at the end of a
        column's name may be left out.
    times : tuple of str
        What gives the time, ``COLUMN``, ``COLUMN:us`` or ``200Hz``; empty for the usual names.
    output_only : bool
        There is no input; without outputs, all columns are but the time.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    times: tuple[str, ...] = ()
    output_only: bool = False


def named_columns(path: Path, asked: TableColumns) -> CsvMap:
    """Return the map of a file whose time is the column that is called so, such as ``time_ms``.

    Raises
    ------
    CsvImportError
        If the file cannot be read, no column or several are called a time, there is no input or no
        output, or a column or a name comes twice.
    """
    layout = table_layout(path)
    names = layout.names
    there = shorten(", ".join(names), _LONGEST)
    inputs, outputs = asked.inputs, asked.outputs
    column, unit, rate_hz = _named_time(asked.times, names)
    if asked.output_only:
        others = (name for name in names if name not in {column, *_times(layout)})
        outputs = outputs or tuple(others)
    elif not (inputs and outputs):
        raise CsvImportError(
            f"{path}: a model needs --input COLUMN and --output COLUMN; columns: {there}; "
            "modes alone need no input: --output-only"
        )
    channels = [_channel(text, names) for text in (*inputs, *outputs)]
    if not (column or rate_hz):
        column = _only_time(path, layout, [each.column for each in channels])
    clocks = _own_times(layout, column, [each.column for each in channels])
    for said in ([each.column for each in channels], [each.name for each in channels]):
        if twice := named_twice(said):
            raise CsvImportError(f"{path}: {twice}: take it once")
    return CsvMap(
        tuple(channels[: len(inputs)]),
        tuple(channels[len(inputs) :]),
        time=column or None,
        time_unit=unit,
        rate_hz=rate_hz,
        clocks=clocks,
    )


def guessed_columns(
    path: Path, inputs: Sequence[str], outputs: Sequence[str], times: Sequence[str] = ()
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return inputs and outputs of a file of which one or both were not said.

    Inputs are columns that are called a command, such as ``torque`` or ``u1``; all others are
    outputs, but for the time.

    Raises
    ------
    CsvImportError
        If the file cannot be read, or no column is called a command.
    """
    layout = table_layout(path)
    column, *_ = _named_time(times, layout.names)
    taken = {column, *_times(layout), *(text.rpartition("=")[2] for text in (*inputs, *outputs))}
    free = [name for name in layout.names if name and name not in taken]
    commands = [name for name in free if _COMMAND.fullmatch(_ENDING.sub("", name))]
    found = tuple(inputs or commands)
    if not found:
        raise CsvImportError(
            f"{path}: no column is called a command, such as torque or u: name it with --input; "
            f"{columns_text(layout)}"
        )
    return found, tuple(outputs or [name for name in free if name not in found])


def _named_time(times: Sequence[str], names: Sequence[str]) -> tuple[str, str, float | None]:
    """Return the column and its unit, each empty where none is given, and the rate."""
    column, unit, rate_hz = "", "", None
    for text in times:
        if text not in names and (found := _RATE.fullmatch(text)):
            rate_hz = float(found[1])
        else:
            stem, _, end = text.rpartition(":")
            column, unit = (stem, end) if end in TIME_UNITS_S and text not in names else (text, "")
    return column, unit, rate_hz


def _own_times(layout: Layout, time: str, channels: Sequence[str]) -> tuple[str, ...]:
    """Return the nearest time before each channel, where several columns have the time's name."""
    stem, sign, _ = time.partition("#")
    times = [name for name in layout.names if sign and name.partition("#")[0] == stem]
    places = [layout.names.index(name) for name in times]
    own = [bisect(places, layout.names.index(name)) for name in channels if name in layout.names]
    return tuple(times[number - 1] for number in own) if own and 0 < min(own) < max(own) else ()


def _only_time(path: Path, layout: Layout, taken: Sequence[str]) -> str:
    times = _times(layout)
    free = [name for name in times if name not in taken]
    if len(free) == 1:
        return free[0]
    if len({name.partition("#")[0] for name in free}) == 1 and _own_times(layout, free[0], taken):
        return free[0]
    if times and not free:
        raise CsvImportError(
            f"{path}: {times[0]} is the time: it is neither an input nor an output"
        )
    if not free and _FREQUENCY.fullmatch(_ENDING.sub("", layout.names[0])):
        raise CsvImportError(
            f"{path}: column {layout.names[0]} is a frequency and not a time, as of a spectrum or "
            "a frequency response: give the samples that it was made from"
        )
    problem = (
        f"{' and '.join(free)} are times"
        if free
        else "no column is called a time, such as t or time_ms"
    )
    rate = f"{layout.rate_hz:g}Hz, as its head says," if layout.rate_hz else "200Hz,"
    raise CsvImportError(
        f"{path}: {problem}: say --time COLUMN, --time COLUMN:us or --time {rate} or write a map "
        f"with time: COLUMN or rate_hz: NUMBER, and give it as --map; {columns_text(layout)}"
    )


def unused_time(path: Path, mapping: CsvMap, layout: Layout | None = None) -> tuple[str, ...]:
    """Return that a column is called a time and not used, of a map with a rate alone.

    Raises
    ------
    CsvImportError
        If the file cannot be read.
    """
    if mapping.time is not None:
        return ()
    free = [n for n in _times(layout or table_layout(path)) if n not in mapping.columns()]
    return tuple(
        f"column {name} was not used: the map puts the rows at {mapping.rate_hz:g} Hz; with "
        f"time: {name} beside it they are resampled, and with that alone they set the rate"
        for name in free[:1]
    )


def other_clocks(path: Path, mapping: CsvMap, layout: Layout) -> tuple[str, ...]:
    """Return that a column is a clock of another rate than the time, such as a second device's.

    Raises
    ------
    CsvImportError
        If the file cannot be read.
    """
    if mapping.time is None:
        return ()
    chosen = []
    for name in layout.names:
        if name in (*mapping.clocks, *mapping.columns()) or not _CLOCK.fullmatch(name):
            continue
        with suppress(CsvImportError):
            alone = replace(mapping, inputs=(), outputs=(CsvChannel(name, name),))
            times_s, own = read_table(path, alone, layout).values.T
            times_s, own = times_s[np.isfinite(own)], own[np.isfinite(own)]
            steps = np.diff(own)
            if steps.min() <= 0.0 or steps.max() == steps.min() == 1.0:
                # It is not a clock, or counts the rows.
                continue
            slope_s = (times_s[-1] - times_s[0]) / (own[-1] - own[0])
            if not any(abs(slope_s / unit - 1.0) < _SAME_RATE for unit in TIME_UNITS_S.values()):
                chosen.append(name)
    return tuple(
        f"column {name} is a clock of another rate than {mapping.time}: what it belongs to was "
        "sampled at other instants than those of the rows; make a file of each device"
        for name in chosen
    )


def with_units(mapping: CsvMap, layout: Layout) -> CsvMap:
    """Return a map with the units that the file gives for channels which have none."""

    def chosen(channels: tuple[CsvChannel, ...]) -> tuple[CsvChannel, ...]:
        return tuple(
            replace(each, unit=each.unit or file_unit(each.column, layout)) for each in channels
        )

    return replace(mapping, inputs=chosen(mapping.inputs), outputs=chosen(mapping.outputs))


def file_unit(column: str, layout: Layout) -> str:
    """Return the unit that a file gives for a column, in its name or below it; else empty."""
    ending = _ENDING.search(column)
    own = (ending["square"] or ending["round"] or "") if ending else ""
    return own.strip() or layout.unit(column).strip("()[] ")


def _times(layout: Layout) -> list[str]:
    """Return the columns of times: by their names, their units or as dates and clocks."""
    cells = dict(zip(layout.names, layout.cells, strict=False))
    named = [
        name
        for name in layout.names
        if _TIME.fullmatch(name)
        and not (_WHOLE_SECONDS.fullmatch(name) and not nanoseconds_of(name, layout.names))
        # A date is in another column than the time of the day.
        and not (is_clock(cells.get(name, "")) and not set(":T") & set(cells[name]))
    ]
    chosen = named or [
        name
        for name in layout.names
        if (":" in cells.get(name, "") and is_clock(cells[name]))
        or ((unit := layout.unit(name)) and time_unit_s(f"t [{unit.strip('()[] ')}]"))
    ]
    return chosen or [name for name in layout.names if _HAS_TIME.fullmatch(name)]


def _channel(text: str, names: Sequence[str]) -> CsvChannel:
    """Return a channel; a column may have the sign of equality in its own name."""
    name, sign, column = text.partition("=")
    if not sign or text in names:
        name = column = text
    if column not in names:
        alike = [each for each in names if _ENDING.sub("", each) == column]
        column = alike[0] if len(alike) == 1 else column
    return CsvChannel(column, name)
