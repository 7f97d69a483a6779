"""Bags as records of experiments: the only file of this package that opens a bag.

How times are chosen: the sampling period comes from the header stamps, the instants of sampling.
References have no header: they are ordered by log time, which our recorder sets to the instant of
sending. Which input acts on which sample is decided in :mod:`flexarm_ident.reading.alignment`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_bags.reader import ARM_STATE, MOTOR_COMMAND, REFERENCE, opened, sibling
from flexarm_core.errors import BagError, DataError
from flexarm_ident.reading.alignment import (
    BagReading,
    arm_header,
    arm_reading,
    arm_rows,
    arm_timetable,
    io_header,
    io_reading,
    io_rows,
    io_timetable,
    marks,
)
from flexarm_ident.reading.loop_kind import loop_kind
from flexarm_ident.reading.stream import leading_rows, open_stream

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.reading.stream import BagStream
    from flexarm_ident.records.iodata import IoData


def read_bag(uri: Path | str, *, topic: str | None = None) -> IoData:
    """Read the record of an experiment from a bag.

    Parameters
    ----------
    uri
        rosbag2 folder (MCAP or SQLite, split or compressed) or a single ``.mcap`` or ``.db3`` file.
    topic
        Topic of ArmState or IoSample messages; None takes the only one, ArmState first.

    Returns
    -------
    IoData
        The samples on the grid of their period, in the longest run of numbers that go up. Its
        `missing` tells of holes, its `notices` what there is to know of them.

    Raises
    ------
    BagError
        If the bag is missing, damaged, or holds no usable samples.
    """
    return read_bag_report(uri, topic=topic).data


def read_bag_report(uri: Path | str, *, topic: str | None = None) -> BagReading:
    """Read the record of an experiment from a bag, with everything worth knowing about it.

    Parameters
    ----------
    uri
        rosbag2 folder (MCAP or SQLite, split or compressed) or a single ``.mcap`` or ``.db3`` file.
    topic
        Topic of ArmState or IoSample messages; None takes the only one, ArmState first.

    Returns
    -------
    BagReading
        The record, warnings, and the counts of samples and of lost samples.

    Raises
    ------
    BagError
        If the bag is missing, damaged, or holds no usable samples.
    """
    path = Path(uri)
    with opened(path) as bag:
        chosen = bag.choose(topic)
        if bag.types[chosen] == ARM_STATE:
            return arm_reading(
                bag.recorded(chosen),
                bag.optional(sibling(chosen, "reference"), REFERENCE),
                partial(bag.every, sibling(chosen, "command"), MOTOR_COMMAND),
                declared=bag.declared_loops(chosen),
                source=str(path),
            )
        return io_reading(
            bag.recorded(chosen), bag.channels(sibling(chosen, "io_channels")), source=str(path)
        )


def stream_bag(uri: Path | str, *, topic: str | None = None) -> BagStream:
    """Open a bag as a source for the identification that is never in memory as a whole.

    It is the record that `read_bag` returns, without the Coulomb compensation (section 2.4.3) and
    otherwise unprocessed. Sixteen bytes a sample stay in memory.

    Parameters
    ----------
    uri
        rosbag2 folder (MCAP, not compressed by file or message) or a single ``.mcap`` file.
    topic
        Topic of ArmState or IoSample messages; None takes the only one, ArmState first.

    Returns
    -------
    BagStream
        The record; every pass over it reads the bag again.

    Raises
    ------
    BagError
        If the bag is missing, damaged, not chunked and indexed, or holds no usable samples.
    """
    path = Path(uri)
    source = str(path)
    with opened(path) as bag:
        chosen = bag.choose(topic)
        is_arm = bag.types[chosen] == ARM_STATE
        found = marks(bag.pieces(chosen))
        if is_arm:
            command = sibling(chosen, "command")
            commanded = bag.has(command, MOTOR_COMMAND)
            table = arm_timetable(found, lambda: bag.pieces(command) if commanded else ())
            header, declared = arm_header(table, source), bag.declared_loops(chosen)
        else:
            table = io_timetable(found)
            first = next(bag.pieces(chosen))
            widths = (first.real("inputs").shape[1], first.real("outputs").shape[1])
            header = io_header(table, bag.channels(sibling(chosen, "io_channels")), widths, source)

    def rows() -> Iterator[tuple[FloatArray, FloatArray]]:
        with opened(path) as bag:
            if not is_arm:
                yield from io_rows(table, bag.pieces(chosen))
                return
            for u, y in arm_rows(table, bag.pieces(chosen)):
                yield u[:, :1] - u[:, 1:], y

    def judged(samples: int) -> IoData:
        with opened(path) as bag:
            commanded = ((u[:, :1], y) for u, y in arm_rows(table, bag.pieces(chosen)))
            return leading_rows(header, commanded, samples)

    try:
        stream = open_stream(header, table.rows, rows)
    except DataError as error:
        raise BagError(str(error)) from error
    if not is_arm:
        return stream
    return replace(stream, header=replace(header, closed_loop=loop_kind(declared, judged)))


def sample_count(uri: Path | str, *, topic: str | None = None) -> int:
    """Return how many messages with samples a bag has, from its index.

    Parameters
    ----------
    uri
        As in :func:`read_bag`.
    topic
        As in :func:`read_bag`.

    Returns
    -------
    int
        Messages on the topic.

    Raises
    ------
    BagError
        If the bag is missing or damaged, or holds no samples.
    """
    with opened(Path(uri)) as bag:
        return bag.count(bag.choose(topic))
