"""Options that say what of a record is read: signals or columns, and a part of the time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console.quantity import TIME_S, Quantity
from flexarm_bringup.console.verb_group import together
from flexarm_core.errors import BagError
from flexarm_ident.importing.csv_columns import TableColumns
from flexarm_ident.importing.csv_layout import is_table
from flexarm_ident.reading.channels import CLOCKS, Selection, selection
from flexarm_ident.reading.fields import parse_field
from flexarm_ident.reading.read import signals_text
from flexarm_ident.records.span import Span

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.importing.csv_map import CsvMap

channel_options = together(
    click.option(
        "--input",
        "inputs",
        multiple=True,
        metavar="TOPIC.FIELD",
        help="Input in a bag of other messages, such as /command.data, or column of a CSV file; "
        "repeat. NAME=TOPIC.FIELD names it.",
    ),
    click.option(
        "--output",
        "outputs",
        multiple=True,
        metavar="TOPIC.FIELD",
        help="Output, such as /joint_states.position[0], or column; repeat.",
    ),
    click.option(
        "--time",
        "times",
        multiple=True,
        metavar="TIME",
        help="Time of a CSV file: COLUMN, COLUMN:us or a rate, 200Hz; both to resample.",
    ),
    click.option(
        "--clock",
        type=click.Choice(CLOCKS),
        help="Time stamps of other messages; else headers where every topic has them.",
    ),
    click.option(
        "--held/--interpolated",
        default=True,
        show_default=True,
        help="Input hold: zero-order (commands) or first-order (measured).",
    ),
    click.option(
        "--from",
        "from_s",
        type=Quantity(TIME_S, 0.0),
        default=0.0,
        metavar="TIME",
        help="Start of the part to use, s from the start of each record.",
    ),
    click.option(
        "--to",
        "to_s",
        type=Quantity(TIME_S, 0.0),
        metavar="TIME",
        help="End of the part to use; the record's end by default.",
    ),
    click.option(
        "--wrap",
        type=click.FloatRange(min=0.0),
        metavar="PERIOD",
        help="Counts per turn at which an output wraps, such as 4000; 0: none. Found by default.",
    ),
)
"""Options of a verb, which takes them by `taken_part`."""
_SPREADSHEETS = frozenset({".xlsx", ".xls", ".ods"})


def taken_channels(options: dict[str, Any], bag: Path) -> Selection | None:
    """Take the channels out of the options; None when none is named.

    Raises
    ------
    BagError
        When a name is none of a field, with those that a bag has.
    """
    inputs, outputs, clock, held = (
        options.pop(name) for name in ("inputs", "outputs", "clock", "held")
    )
    output_only = options.pop("output_only", False)
    if not (inputs or outputs):
        if clock or not held:
            raise click.UsageError(
                "--clock and --interpolated belong to --input and --output of a bag"
            )
        return None
    try:
        for name in (*inputs, *outputs):
            parse_field(name)
    except BagError as error:
        raise BagError(f"{error}; {signals_text(bag)}") from error
    return selection(inputs, outputs, clock=clock, interpolated=not held, output_only=output_only)


def taken_part(
    paths: Sequence[Path], options: dict[str, Any], map_file: Path | None = None
) -> dict[str, Any]:
    """Take what of the records is read out of the options: `channels` and `span` of a job."""
    columns = taken_columns(paths, map_file, options)
    span = Span(options.pop("from_s"), options.pop("to_s"), options.pop("wrap"))
    return {"channels": taken_channels(options, paths[0]) or columns, "span": span}


def taken_columns(
    paths: Sequence[Path], map_file: Path | None, options: dict[str, Any]
) -> CsvMap | TableColumns | None:
    """Return what names the columns of the CSV files: a map, or names taken out of the options.

    Where there is no CSV file, names stay in the options: those of signals of bags.
    """
    _refuse_unfit(paths)
    tables = [path for path in paths if is_table(path)]
    output_only = options.get("output_only", False) and bool(tables)
    times = options.pop("times", ())
    named = TableColumns(options["inputs"], options["outputs"], times, output_only)
    is_named = bool(named.inputs or named.outputs or times or output_only)
    if map_file and (named.inputs or named.outputs or times):
        raise click.UsageError("give --map, or --input, --output and --time: both name the columns")
    if times and not (tables and (output_only or (named.inputs and named.outputs))):
        raise click.UsageError(
            "--time belongs to a CSV file with --input and --output, or --output-only"
        )
    if not tables:
        if map_file:
            raise click.UsageError("--map belongs to a CSV file, and none is named")
        return None
    if map_file:
        from flexarm_ident.importing.csv_map import load_csv_map  # noqa: PLC0415 - not for bags

        return load_csv_map(map_file)
    if not is_named:
        _refuse_unnamed(tables[0])
    if gone := [str(path) for path in paths if not path.exists()]:
        raise click.UsageError(f"no file or bag {gone[0]!r} is there")
    if len(tables) < len(paths):
        raise click.UsageError(
            "--input and --output name columns of CSV files or signals of bags: import the CSV "
            "file first, or give each kind a command of its own"
        )
    options.update(inputs=(), outputs=())
    return named


def _refuse_unnamed(table: Path) -> None:
    from flexarm_ident.importing.csv_table import column_names  # noqa: PLC0415 - not for bags

    names = ", ".join(column_names(table))
    raise click.UsageError(
        f"{table} is a CSV file: say which column is what, by --input COLUMN and --output "
        "COLUMN (modes alone need no input: --output-only) or a file, --map FILE; columns: "
        f"{names}"
    )


def _refuse_unfit(paths: Sequence[Path]) -> None:
    """Refuse spreadsheets, and a path that is named twice."""
    seen: dict[Path, Path] = {}
    for path in paths:
        if path.suffix.lower() in _SPREADSHEETS:
            raise click.UsageError(f"{path} is a spreadsheet: save it as CSV in UTF-8")
        # Unlike `resolve`, this takes a link in a circle as it is.
        other = seen.setdefault(Path(os.path.realpath(path)), path)
        if other is not path:
            raise click.UsageError(f"{path} is named twice, and would count twice: name it once")
