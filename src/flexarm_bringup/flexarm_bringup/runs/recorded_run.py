"""Recorded run: one run of the loop, whose bag is read back before it replaces another."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

from flexarm_bags.check import check_bag
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.runs.pace import in_lockstep, pace_text
from flexarm_ident.reading.read import read_bag_report

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flexarm_bringup.graph.figures import Run
    from flexarm_bringup.graph.operator import Operator
    from flexarm_ident.reading.alignment import BagReading


class RecordedRun(NamedTuple):
    """Run of the loop, its record, and whether it was sampled in virtual time."""

    run: Run
    reading: BagReading
    lockstep: bool


def record_run(
    operator: Operator,
    commander: str,
    record: Path,
    samples: int,
    *,
    text: str,
    bag: Path | None = None,
) -> RecordedRun:
    """Record one run with its progress on the terminal, and refuse an incomplete record.

    Parameters
    ----------
    operator : Operator
        Operator of the graph.
    commander : str
        Name of the node that commands.
    record : Path
        Bag to create.
    samples : int
        Length of the run.
    text : str
        Words beside the progress.
    bag : Path, optional
        Place of a complete record, as in `new_record`; by default it stays where it is.

    Raises
    ------
    LaunchError
        When a node does not do its part, or the record is incomplete.
    """
    with terminal.progress_bar(text, samples) as progress:
        run = operator.recorded_run(commander, str(record), samples, progress)
    return completed_run(run, record, lockstep=in_lockstep(operator), bag=bag)


def completed_run(
    run: Run, record: Path, *, lockstep: bool, bag: Path | None = None
) -> RecordedRun:
    """Read the record of a run back, print what it holds, and refuse an incomplete one.

    Parameters
    ----------
    run : Run
        The run.
    record : Path
        Its bag.
    lockstep : bool
        Whether it was sampled in virtual time.
    bag : Path, optional
        As for `record_run`, like the errors.
    """
    reading = read_bag_report(record)
    require_whole(reading, run.taken, lockstep=lockstep)
    if bag is not None:
        put_in_place(record, bag)
    recorded = run.recorded.replace(str(record), str(bag or record))
    terminal.CONSOLE.print(f"  recorded {recorded}")
    terminal.CONSOLE.print(f"  {pace_text(run)}")
    return RecordedRun(run, reading, lockstep)


def require_whole(reading: BagReading, taken: int, *, lockstep: bool) -> None:
    """Raise a `LaunchError` when a record lacks samples, or a command in virtual time.

    In real time, periods may have been skipped. In virtual time every sample waits for its answer:
    without one, the figures are not those of the seed.
    """
    missing = taken - reading.samples
    if missing > 0:
        raise LaunchError(f"{missing} of {taken} samples are not in the record: see nodes.log")
    if lockstep and reading.unanswered:
        raise LaunchError(
            f"{reading.unanswered} of {taken} samples had no command of their own: the drive was "
            "held at zero, or answers did not come; see nodes.log"
        )


def workplace(bag: Path) -> Path:
    """Return the folder in which the record of a bag is made."""
    return bag.with_name(f"{bag.name}.new")


@contextmanager
def new_record(bag: Path) -> Iterator[Path]:
    """Yield the path to record a bag at; afterwards keep a record that was not put in place.

    A record that was not completed, or refused, is kept as `BAG.partial`, or `BAG.partial2` and so
    on beside older ones.

    Raises
    ------
    FileExistsError
        When its workplace is there already.
    LaunchError
        As raised by the block, with the place in which the record is kept.
    """
    # The name of a bag is also that of the file in it.
    record = workplace(bag) / bag.name
    record.parent.mkdir()
    partial = next(path for path in _partials(bag) if not path.exists())
    try:
        yield record
    except LaunchError as error:
        raise LaunchError(str(error).replace(str(record), str(partial))) from None
    finally:
        if _replaced(record).exists() and not bag.exists():
            _replaced(record).rename(bag)
        if record.exists() and check_bag(record).samples:
            record.rename(partial)
            terminal.CONSOLE.print(f"what was recorded is kept in {partial}")
        shutil.rmtree(record.parent, ignore_errors=True)


def _partials(bag: Path) -> Iterator[Path]:
    """Yield the names of records that were not completed."""
    yield bag.with_name(f"{bag.name}.partial")
    yield from (bag.with_name(f"{bag.name}.partial{number}") for number in count(2))


def put_in_place(record: Path, bag: Path) -> None:
    """Put a record from `new_record` in the bag's place; an older bag is removed after that."""
    if bag.exists():
        bag.rename(_replaced(record))
    record.rename(bag)
    shutil.rmtree(record.parent)


def _replaced(record: Path) -> Path:
    """Return where the old bag is until the new one is in its place."""
    return record.with_name(f"{record.name}.old")
