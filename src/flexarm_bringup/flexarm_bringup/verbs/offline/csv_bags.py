"""CSV files beside bags on a command line: each is imported first."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from flexarm_bringup.console import terminal
from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flexarm_ident.importing.csv_import import CsvRecord, ImportSummary
    from flexarm_ident.importing.csv_map import CsvMap


# No bag is called so.
_TABLES = frozenset(
    {".csv", ".tsv", ".txt", ".dat", ".lvm", ".log", ".asc", ".prn", ".mat", ".h5", ".hdf5"}
    | {".parquet", ".feather", ".tdms"}
)
_SPREADSHEETS = frozenset({".xlsx", ".xls", ".ods"})


class Columns(NamedTuple):
    """Columns of CSV files that are inputs and outputs, as on the command line."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    times: tuple[str, ...] = ()
    output_only: bool = False


def taken_columns(
    paths: Sequence[Path], map_file: Path | None, options: dict[str, Any]
) -> Path | Columns | None:
    """Return what tells the columns of the CSV files: a map, or names taken out of the options.

    Where there is neither, the names stay in the options: those of signals of bags.
    """
    for path in paths:
        if path.suffix.lower() in _SPREADSHEETS:
            raise click.UsageError(f"{path} is a spreadsheet: save it as CSV in UTF-8")
    tables = _tables(paths)
    output_only = options.get("output_only", False) and bool(tables)
    times = options.pop("times", ())
    named = Columns(options["inputs"], options["outputs"], times, output_only)
    if map_file and (named.inputs or named.outputs or times):
        raise click.UsageError("give --map, or --input, --output and --time: both tell the columns")
    if times and not (tables and (output_only or (named.inputs and named.outputs))):
        raise click.UsageError(
            "--time belongs to a CSV file with --input and --output, or --output-only"
        )
    if map_file or not tables or not any(named):
        return map_file
    for path in paths:
        if not path.exists():
            raise click.UsageError(f"no file or bag {str(path)!r} is there")
    if len(tables) < len(paths):
        raise click.UsageError(
            "--input and --output name columns of CSV files or signals of bags: import the CSV "
            "file first, or give each kind a command of its own"
        )
    options.update(inputs=(), outputs=())
    return named


def imported(csv: Path, map_file: Path, bag: Path) -> ImportSummary:
    """Turn a CSV file into a new bag for keeps, by the map of its columns."""
    from flexarm_ident.importing.csv_map import load_csv_map  # noqa: PLC0415 - not for the help

    return _imported(csv, load_csv_map(map_file), bag)


@contextmanager
def as_bags(paths: Sequence[Path], columns: Path | Columns | None) -> Iterator[dict[Path, str]]:
    """Give bags for paths, each with the path as it was said, which errors have too.

    A CSV file is a bag of the same name while it lasts.
    """
    _refuse_twice(paths)
    tables = _tables(paths)
    if tables and columns is None:
        from flexarm_ident.importing.csv_table import column_names  # noqa: PLC0415 - not for bags

        names = ", ".join(column_names(tables[0]))
        raise click.UsageError(
            f"{tables[0]} is a CSV file: say which column is what, by --input COLUMN and --output "
            "COLUMN (modes alone need no input: --output-only) or a file, --map FILE; columns: "
            f"{names}"
        )
    if columns is None:
        yield {path: str(path) for path in paths}
        return
    if not tables:
        raise click.UsageError("--map belongs to a CSV file, and none is named")
    with TemporaryDirectory(prefix="flexarm-csv-") as folder:
        bags = {
            _bag_of(path, columns, Path(folder, f"{number}")) if path in tables else path: str(path)
            for number, path in enumerate(paths)
        }
        try:
            yield bags
        except FlexarmError as error:
            raise type(error)(_as_said(str(error), bags)) from error


def _refuse_twice(paths: Sequence[Path]) -> None:
    seen: dict[Path, Path] = {}
    for path in paths:
        # Unlike `resolve`, this takes a link in a circle as it is.
        other = seen.setdefault(Path(os.path.realpath(path)), path)
        if other is not path:
            raise click.UsageError(f"{path} is named twice, and would count twice: name it once")


def _as_said(text: str, bags: Mapping[Path, str]) -> str:
    """Return a text with the paths that were said in the place of those of the bags."""
    for bag, said in bags.items():
        text = text.replace(str(bag), said)
    return text


def _tables(paths: Sequence[Path]) -> list[Path]:
    return [path for path in paths if path.suffix.lower() in _TABLES]


def _bag_of(csv: Path, columns: Path | Columns, folder: Path) -> Path:
    """Return a bag of a CSV file in a new folder, below folders of the same names."""
    from flexarm_ident.importing.csv_map import load_csv_map  # noqa: PLC0415 - not for the help

    bag = folder.joinpath(*csv.absolute().with_suffix("").parts[1:])
    if isinstance(columns, Path):
        return _imported(csv, load_csv_map(columns), bag, kept=False).bag
    return _judged(csv, columns, bag)


def _judged(csv: Path, columns: Columns, bag: Path) -> Path:
    """Import a file of which nobody said whether the outputs made the inputs: the data tell."""
    # They take long to load: not for the help.
    from flexarm_ident.importing.csv_columns import named_columns  # noqa: PLC0415
    from flexarm_ident.records.iodata import IoData  # noqa: PLC0415
    from flexarm_ident.subspace.loop_test import judged_loop  # noqa: PLC0415

    mapping = named_columns(csv, *columns)
    if not mapping.inputs:
        return _imported(csv, mapping, bag, kept=False).bag

    def judged(record: CsvRecord) -> bool:
        u, y = record.even()
        inputs, outputs = (
            tuple(each.name for each in x) for x in (mapping.inputs, mapping.outputs)
        )
        dt_s = 1.0 / record.sampling.rate_hz
        data = IoData(u, y, dt_s=dt_s, inputs=inputs, outputs=outputs)
        return bool(judged_loop(data, feedthrough=True))

    return _imported(csv, mapping, bag, judged, kept=False).bag


def _imported(
    csv: Path,
    mapping: CsvMap,
    bag: Path,
    judged: Callable[[CsvRecord], bool] | None = None,
    *,
    kept: bool = True,
) -> ImportSummary:
    # They load numpy and rosbags.
    from flexarm_bags.schema import own_types, share_of  # noqa: PLC0415
    from flexarm_ident.importing.csv_import import import_csv  # noqa: PLC0415

    made = import_csv(
        csv, mapping, bag, typestore=own_types(), folder_of=share_of, judged=judged, kept=kept
    )
    for text in made.notes:
        terminal.note(f"{csv}: {text}")
    return made
