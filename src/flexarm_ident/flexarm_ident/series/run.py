"""Models of a series of bags: one each, on every core, kept as they come."""

from __future__ import annotations

import hashlib
import json
import re
import signal
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

import joblib

from flexarm_core.errors import DataError, FlexarmError, one_line
from flexarm_ident.job import REPORT_FILE, model_name, read_record, write_results
from flexarm_ident.provenance import record_hash
from flexarm_ident.reading.read import begin_ns
from flexarm_ident.series.rows import Row, model_cells, read_rows, write_rows
from flexarm_ident.series.trend import trend_page, trend_plot
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import Progress
    from flexarm_ident.reading.channels import Selection
    from flexarm_ident.workflow.request import Request

TABLE_FILE = "models.csv"
TREND_FILE = "trend.svg"
PAGE_FILE = "index.html"


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

    bag: Path
    folder: Path
    request: Request
    channels: Selection | None
    exports: tuple[str, ...]
    known: Row | None


def identify_each(
    bags: Sequence[Path],
    folder: Path,
    request: Request,
    *,
    channels: Selection | None = None,
    exports: Sequence[str] = (),
    jobs: int = -1,
    progress: Progress = lambda _stage, _fraction: None,
) -> Series:
    """Identify one model per bag; write their table, the picture of their trend, and each model.

    A bag is skipped when the table has its row already, with the same record and request. A bag
    that fails has a row with the reason, and the others go on. The table is written anew with every
    row: an interrupted run goes on where it stood.

    Parameters
    ----------
    bags : sequence of Path
        Bags, one or more.
    folder : Path
        Folder of the results: `models.csv`, `trend.svg`, `index.html`, and a folder per bag with
        what `job.identify_bags` writes. Rows of other bags in its table stay.
    request, channels, exports
        As in `job.identify_bags`, the same for all.
    jobs : int
        Processes; -1 for one per core.
    progress : callable
        Called with the bag that has ended and the part of all that is done. An exception from it
        ends the run; what has ended is kept.

    Raises
    ------
    DataError
        If two bags would have the same folder, or the table cannot be read.
    OSError
        If the folder cannot be written.
    """
    places = _places(bags)
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / TABLE_FILE
    rows = read_rows(table)
    tasks = [
        _Task(bag, folder / place, request, channels, tuple(exports), rows.get(str(bag)))
        for bag, place in places.items()
    ]
    order = dict.fromkeys([*rows, *map(str, places)])
    skipped = 0
    progress("reading", 0.0)
    for done, (row, is_known) in enumerate(_computed(tasks, jobs), start=1):
        skipped += is_known
        rows[row.bag] = row
        write_rows(table, [rows[bag] for bag in order if bag in rows])
        progress(Path(row.bag).name, done / len(tasks))
    _show(folder, [rows[bag] for bag in order])
    return Series(tuple(rows[str(bag)] for bag in places), skipped)


def _places(bags: Sequence[Path]) -> dict[Path, str]:
    """Return the folder of each bag, named by its path."""
    places = {bag: re.sub(r"\W+", "_", str(bag)).strip("_") or model_name(bag) for bag in bags}
    taken: dict[str, Path] = {}
    for bag, place in places.items():
        if taken.setdefault(place, bag) != bag:
            raise DataError(f"{bag} and {taken[place]} would both be {place}: rename one of them")
    return places


def _computed(tasks: Sequence[_Task], jobs: int) -> Iterator[tuple[Row, bool]]:
    """Yield rows in the order in which they end, and whether they were known."""
    with joblib.parallel_config(
        "loky", n_jobs=jobs, inner_max_num_threads=1, initializer=_leave_interrupts
    ):
        parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1)
        done = parallel(joblib.delayed(_row)(task) for task in tasks)
        try:
            yield from done
        finally:
            done.close()


def _leave_interrupts() -> None:
    """Leave Ctrl-C, which a terminal sends to all processes, to the one that ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _row(task: _Task) -> tuple[Row, bool]:
    """Return the row of a bag, in a worker: the known one, that of a new model, or of a failure."""
    cells: dict[str, str] = {}
    try:
        begun = datetime.fromtimestamp(begin_ns(task.bag) // 10**9, timezone.utc)
        record = read_record(task.bag, task.request, task.channels)
        record_sha256, request_sha256 = record_hash(record), _request_hash(task)
        if task.known is not None and task.known.is_of(record_sha256, request_sha256):
            return task.known, True
        cells |= {"begun": begun.isoformat(), "record_sha256": record_sha256}
        cells |= {"request_sha256": request_sha256}
        outcome = run([record], task.request)
        name = model_name(task.bag)
        write_results(task.folder, outcome, [record], name=name, exports=task.exports)
        cells |= model_cells(outcome)
    except (FlexarmError, OSError) as error:
        cells["failure"] = one_line(error)
    except Exception as error:  # noqa: BLE001 - one bag must not take the others with it
        cells["failure"] = f"internal error: {type(error).__name__}: {one_line(error)}"
    return Row(str(task.bag), cells), False


def _request_hash(task: _Task) -> str:
    chosen = None if task.channels is None else asdict(task.channels)
    return hashlib.sha256(json.dumps([asdict(task.request), chosen]).encode()).hexdigest()


def _show(folder: Path, rows: Sequence[Row]) -> None:
    """Write the picture and the page of all rows in the table."""
    modelled = [row for row in rows if not row.failure]
    picture = trend_plot(modelled) if modelled else ""
    if picture:
        (folder / TREND_FILE).write_text(picture, encoding="utf-8")
    places = _places([Path(row.bag) for row in modelled])
    reports = {str(bag): f"{place}/{REPORT_FILE}" for bag, place in places.items()}
    page = trend_page(rows, picture, reports, TABLE_FILE)
    (folder / PAGE_FILE).write_text(page, encoding="utf-8")
