"""CSV files beside bags on a command line: each is imported first."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_daq.importing.csv_import import ImportSummary


def imported(csv: Path, map_file: Path, bag: Path) -> ImportSummary:
    """Turn a CSV file into a new bag, by the map of its columns."""
    # They load numpy and rosbags: not for the help.
    from flexarm_bags.schema import own_types, share_of  # noqa: PLC0415
    from flexarm_daq.importing.csv_import import import_csv  # noqa: PLC0415
    from flexarm_daq.importing.csv_map import load_csv_map  # noqa: PLC0415

    return import_csv(csv, load_csv_map(map_file), bag, typestore=own_types(), folder_of=share_of)


@contextmanager
def as_bags(paths: Sequence[Path], map_file: Path | None) -> Iterator[tuple[Path, ...]]:
    """Give bags for paths, with a bag of the same name for each CSV file while it lasts."""
    tables = [path for path in paths if path.suffix.lower() == ".csv"]
    if tables and map_file is None:
        raise click.UsageError(
            f"{tables[0]} is a CSV file: --map FILE says which column is what "
            "(docs/howto/own_csv.md)"
        )
    if map_file is None:
        yield tuple(paths)
        return
    if not tables:
        raise click.UsageError("--map belongs to a CSV file, and none is named")
    with TemporaryDirectory(prefix="flexarm-csv-") as folder:
        yield tuple(
            imported(path, map_file, Path(folder, f"{number}", path.stem)).bag
            if path in tables
            else path
            for number, path in enumerate(paths)
        )
