"""CSV files beside bags on a command line: what names their columns."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_ident.importing.csv_columns import TableColumns
from flexarm_ident.importing.csv_layout import is_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.importing.csv_map import CsvMap

_SPREADSHEETS = frozenset({".xlsx", ".xls", ".ods"})


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
