"""Place of a record beside its bag: nothing is replaced before the new one is complete."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from itertools import count
from typing import TYPE_CHECKING

from flexarm_bags.check import check_bag
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


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
