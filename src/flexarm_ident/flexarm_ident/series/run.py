"""Models of a series of bags: one each, on every core, kept as they come."""

from __future__ import annotations

import hashlib
import importlib
import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import DataError, FlexarmError, one_line
from flexarm_core.outputs import require_place
from flexarm_core.workers import Workers, computed
from flexarm_ident.job import REPORT_FILE, begun, model_name, read_record, write_results
from flexarm_ident.provenance import record_hash
from flexarm_ident.records.span import EVERYTHING, Span
from flexarm_ident.series.rows import (
    Row,
    model_cells,
    read_rows,
    trend_page,
    trend_plot,
    write_rows,
)
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import Progress
    from flexarm_ident.job import Chosen
    from flexarm_ident.workflow.request import Request

TABLE_FILE = "models.csv"
PARQUET_FILE = "models.parquet"
PAGE_FILE = "index.html"
_TEXTS = ("bag", "verdict", "method", "failure", "record_sha256", "request_sha256")


@dataclass(frozen=True, eq=False)
class Series:
    """Models of a series.

    Attributes
    ----------
    rows : tuple of Row
        One per bag, in the order of the bags.
    skipped : int
        Bags whose models were there already.
    """

    rows: tuple[Row, ...]
    skipped: int

    @property
    def failed(self) -> int:
        """Bags without a model."""
        return sum(bool(row.failure) for row in self.rows)


@dataclass(frozen=True)
class _Task:
    """One bag, and the row that it has already."""

    name: str
    bag: Path
    folder: Path
    request: Request
    channels: Chosen
    span: Span
    exports: tuple[str, ...]
    force: bool
    known: Row | None


def identify_each(
    bags: Sequence[Path],
    folder: Path,
    request: Request,
    *,
    channels: Chosen = None,
    span: Span = EVERYTHING,
    exports: Sequence[str] = (),
    force: bool = False,
    parquet: bool = False,
    workers: Workers | None = None,
    progress: Progress = lambda _stage, _fraction: None,
) -> Series:
    """Identify one model per bag; write their table, the page of their trend, and each model.

    A bag is skipped when the table has its row already, with the same record and request. A bag
    that fails has a row with the reason, and the others go on. The table is written anew with every
    row: an interrupted run goes on where it stood.

    Parameters
    ----------
    bags : sequence of Path
        Bags, one or more.
    folder : Path
        Folder of the results: `models.csv`, `index.html`, and a folder per bag with what
        `job.identify_bags` writes. Rows of other bags in its table stay.
    request, channels, span, exports, force
        As in `job.identify_bags`, the same for all.
    parquet : bool
        Whether the table is written as `models.parquet` too, at the end.
    workers : Workers, optional
        Processes, by default one per core. Those of a cluster need the bags and the folder under
        the same paths as here.
    progress : callable
        Called with the bag that has ended and the part of all that is done. An exception from it
        ends the run; what has ended is kept.

    Raises
    ------
    DataError
        If two bags would have the same folder, the table cannot be read, or pyarrow is missing.
    OutputError
        If the folder cannot be written, or has a page of somebody else.
    """
    names = list(map(str, bags))
    places = _places(names)
    require_place([folder / PAGE_FILE], force=force)
    table = folder / TABLE_FILE
    if parquet:
        require_parquet()
        # Binary as it is, it carries no mark: it is our own where our own table stands beside it.
        if not table.exists():
            require_place([folder / PARQUET_FILE], force=force)
    folder.mkdir(parents=True, exist_ok=True)
    rows = read_rows(table)
    tasks = [
        _Task(
            name,
            bag.absolute(),
            (folder / places[name]).absolute(),
            request,
            channels,
            span,
            tuple(exports),
            force,
            rows.get(name),
        )
        for bag, name in zip(bags, names, strict=True)
    ]
    order = dict.fromkeys([*rows, *places])
    skipped = 0
    progress("reading", 0.0)
    ended = computed(_row, [(task,) for task in tasks], workers or Workers())
    for done, (number, found, failure) in enumerate(ended, start=1):
        row, is_known = found or (Row(tasks[number].name, {"failure": failure}), False)
        skipped += is_known
        rows[row.bag] = row
        write_rows(table, [rows[bag] for bag in order if bag in rows])
        progress(Path(row.bag).name, done / len(tasks))
    _show(folder, [rows[bag] for bag in order])
    if parquet:
        write_parquet(table, folder / PARQUET_FILE)
    return Series(tuple(rows[name] for name in places), skipped)


def _places(bags: Sequence[str]) -> dict[str, str]:
    """Return the folder of each bag, named by its path."""
    places = {bag: re.sub(r"\W+", "_", bag).strip("_") or model_name(Path(bag)) for bag in bags}
    taken: dict[str, str] = {}
    for bag, place in places.items():
        if taken.setdefault(place, bag) != bag:
            raise DataError(f"{bag} and {taken[place]} would both be {place}: rename one of them")
    return places


def _row(task: _Task) -> tuple[Row, bool]:
    """Return the row of a bag, in a worker: the known one, that of a new model, or of a failure."""
    cells: dict[str, str] = {}
    try:
        since = begun(task.bag)
        record = read_record(task.bag, task.request, task.channels, task.span)
        record_sha256, request_sha256 = record_hash(record), _request_hash(task)
        if task.known is not None and task.known.is_of(record_sha256, request_sha256):
            return task.known, True
        cells |= {"begun": since, "record_sha256": record_sha256}
        cells |= {"request_sha256": request_sha256}
        outcome = run([record], task.request)
        name = model_name(task.bag)
        write_results(
            task.folder,
            outcome,
            [record],
            name=name,
            exports=task.exports,
            force=task.force,
            begun=since,
        )
        cells |= model_cells(outcome)
    except (FlexarmError, OSError) as error:
        cells["failure"] = one_line(error).replace(str(task.bag), task.name)
    return Row(task.name, cells), False


def _request_hash(task: _Task) -> str:
    chosen = None if task.channels is None else asdict(task.channels)
    return hashlib.sha256(json.dumps([asdict(task.request), chosen]).encode()).hexdigest()


def _show(folder: Path, rows: Sequence[Row]) -> None:
    """Write the page of all rows in the table."""
    modelled = [row for row in rows if not row.failure]
    plot = trend_plot(modelled) if modelled else ""
    places = _places([row.bag for row in modelled])
    reports = {bag: f"{place}/{REPORT_FILE}" for bag, place in places.items()}
    page = trend_page(rows, plot, reports, TABLE_FILE)
    (folder / PAGE_FILE).write_text(page, encoding="utf-8")


def require_parquet() -> None:
    """Raise a DataError that names the remedy when pyarrow, an optional package, is missing."""
    _arrow()


def write_parquet(table: Path, file: Path) -> None:
    """Write the CSV table of a series as Parquet: figures as numbers, `begun` as an instant."""
    arrow = _arrow()
    csv, parquet = (importlib.import_module(f"pyarrow.{part}") for part in ("csv", "parquet"))
    types = dict.fromkeys(_TEXTS, arrow.string()) | {"begun": arrow.timestamp("s", tz="UTC")}
    # An empty cell is a figure that does not exist.
    options = csv.ConvertOptions(column_types=types, strings_can_be_null=True)
    parquet.write_table(csv.read_csv(table, convert_options=options), file)


def _arrow() -> Any:  # noqa: ANN401 - a module without types
    try:
        return importlib.import_module("pyarrow")
    except ImportError:
        raise DataError("--parquet needs pyarrow: pip install -r requirements/parquet.in") from None
