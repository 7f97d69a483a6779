"""Map of a CSV file from the names of its columns alone, where nobody wrote one."""

from __future__ import annotations

import re
from textwrap import shorten
from typing import TYPE_CHECKING

from flexarm_core.labels import TIME_UNIT_ENDING, named_twice
from flexarm_daq.importing.csv_map import CsvChannel, CsvMap
from flexarm_daq.importing.csv_table import CsvImportError, column_names

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_TIME = re.compile(rf"(t|time|timestamp|elapsed|seconds|zeit)({TIME_UNIT_ENDING})?", re.IGNORECASE)
_LONGEST = 300


def named_columns(
    path: Path, inputs: Sequence[str], outputs: Sequence[str], *, output_only: bool = False
) -> CsvMap:
    """Return the map of a file whose time is the column that is called so, such as ``time_ms``.

    Parameters
    ----------
    path : Path
        Comma separated file with the column names in its first line.
    inputs, outputs : sequence of str
        Columns, each as ``COLUMN`` or ``NAME=COLUMN``.
    output_only : bool
        There is no input; without outputs, all columns are but the time.

    Raises
    ------
    CsvImportError
        If the file cannot be read, no column or several are called a time, there is no input or no
        output, or a column or a name comes twice.
    """
    names = column_names(path)
    there = shorten(", ".join(names), _LONGEST)
    if output_only:
        outputs = outputs or [name for name in names if not _TIME.fullmatch(name)]
    elif not (inputs and outputs):
        raise CsvImportError(
            f"{path}: a model needs --input COLUMN and --output COLUMN; columns: {there}; "
            "modes alone need no input: --output-only"
        )
    channels = [_channel(text, names) for text in (*inputs, *outputs)]
    times = _times(names)
    free = [name for name in times if name not in {each.column for each in channels}]
    if len(free) != 1:
        if times and not free:
            raise CsvImportError(f"{path}: {times[0]} is the time: it is no input and no output")
        problem = (
            f"{' and '.join(free)} are times"
            if free
            else "no column is called a time, such as t or time_ms"
        )
        raise CsvImportError(
            f"{path}: {problem}: write a map with time: COLUMN or rate_hz: NUMBER, and give it as "
            f"--map; columns: {there}"
        )
    for said in ([each.column for each in channels], [each.name for each in channels]):
        if twice := named_twice(said):
            raise CsvImportError(f"{path}: {twice}: take it once")
    return CsvMap(tuple(channels[: len(inputs)]), tuple(channels[len(inputs) :]), time=free[0])


def unused_time(path: Path, mapping: CsvMap) -> tuple[str, ...]:
    """Return that a column is called a time and not used, of a map with a rate alone.

    Raises
    ------
    CsvImportError
        If the file cannot be read.
    """
    if mapping.time is not None:
        return ()
    free = [name for name in _times(column_names(path)) if name not in mapping.columns()]
    return tuple(
        f"column {name} was not used: the map puts the rows at {mapping.rate_hz:g} Hz; with "
        f"time: {name} beside it they are resampled, and with that alone they tell the rate"
        for name in free[:1]
    )


def _times(names: Sequence[str]) -> list[str]:
    return [name for name in names if _TIME.fullmatch(name)]


def _channel(text: str, names: Sequence[str]) -> CsvChannel:
    """Return a channel; a column may have the sign of equality in its own name."""
    name, sign, column = text.partition("=")
    return CsvChannel(column, name) if sign and text not in names else CsvChannel(text, text)
