"""Bag reading: the only module of this package that opens a bag.

The sampling period comes from the header stamps, the instants of sampling. References have no
header: they are ordered by log time, which our recorder sets to the instant of sending.
:mod:`flexarm_ident.reading.alignment` decides which input acts on which sample.
"""

from __future__ import annotations

from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_bags.reader import (
    ARM_STATE,
    IO_COMMAND,
    IO_SAMPLE,
    MOTOR_COMMAND,
    REFERENCE,
    REFERENCES,
    opened,
    sibling,
)
from flexarm_core.errors import BagError, SettingError
from flexarm_core.labels import without_dots
from flexarm_core.rig_description import described
from flexarm_ident.reading.alignment import arm_alignment, io_alignment
from flexarm_ident.reading.channels import selected
from flexarm_ident.reading.fields import number_fields, numbers_in
from flexarm_ident.reading.recorded_changes import recorded_changes
from flexarm_ident.reading.stream import BagStream

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flexarm_bags.reader import Bag, Recorded
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.reading.alignment import Alignment, BagReading, Pieces
    from flexarm_ident.reading.channels import Selection
    from flexarm_ident.records.iodata import IoData

# Clocks that begin at 0 when a machine or a simulation starts are far below.
_FIRST_ROS_YEAR = 2007


def read_bag(uri: Path | str, *, topic: str | None = None, wrap: float | None = None) -> IoData:
    """Read the record of an experiment from a bag.

    Parameters
    ----------
    uri : Path or str
        rosbag2 folder (MCAP or SQLite, split or compressed) or a single ``.mcap`` or ``.db3`` file.
    topic : str, optional
        Topic of ArmState or IoSample messages; None takes the only one, ArmState first.
    wrap : float, optional
        Period at which outputs wrap, as an encoder's does at 360; 0: none does. None: found.

    Returns
    -------
    IoData
        The samples on the grid of their period, in the longest run of rising numbers. Its `missing`
        marks holes, its `notices` report defects.

    Raises
    ------
    BagError
        If the bag is missing, damaged, or has no usable samples.
    """
    return read_bag_report(uri, topic=topic, wrap=wrap).data


def read_bag_report(
    uri: Path | str, *, topic: str | None = None, wrap: float | None = None
) -> BagReading:
    """Read a record as `read_bag` does, with the counts of its samples and its warnings."""
    with opened(Path(uri)) as bag:
        chosen = _chosen(bag, topic)
        samples = bag.recorded(chosen)
        commands = partial(bag.every, *_commands_of(bag, chosen))
        aligned = _aligned(bag, chosen, lambda: [samples], commands, wrap)
        if not aligned.is_running:
            return aligned.reading(samples)
        reference, tracked = _set_points(bag, chosen, aligned.header.outputs)
        return aligned.reading(
            samples,
            reference=reference,
            tracked=tracked,
            declared=bag.declared_loops(chosen),
            changes=recorded_changes(bag, chosen, samples, aligned.table),
        )


def stream_bag(uri: Path | str, *, wrap: float | None = None) -> BagStream:
    """Open a bag as a source for the identification that is never in memory as a whole.

    It is the record of `read_bag` without the Coulomb compensation (section 2.4.3), otherwise
    unprocessed. Sixteen bytes a sample stay in memory. Every pass over it reads the bag again.

    Parameters
    ----------
    uri : Path or str
        rosbag2 folder (MCAP, not compressed by file or message) or a single ``.mcap`` file.
    wrap : float, optional
        As in `read_bag`.

    Raises
    ------
    BagError
        If the bag is missing, damaged, not chunked and indexed, or has no usable samples.
    """
    path = Path(uri)
    with opened(path) as bag:
        chosen = _chosen(bag, None)
        pieces = partial(bag.pieces, chosen)
        aligned = _aligned(bag, chosen, pieces, lambda: _command_pieces(bag, chosen), wrap)
        header = aligned.header
        header.check(aligned.efforts(pieces()))
        closed_loop = aligned.loop_kind(bag.declared_loops(chosen))

    def efforts() -> Iterator[tuple[FloatArray, FloatArray]]:
        with opened(path) as bag:
            yield from aligned.efforts(bag.pieces(chosen))

    facts = {**header.facts, "closed_loop": closed_loop}
    return BagStream(**facts, _rows=aligned.table.rows, _open=efforts)


def sample_count(uri: Path | str) -> int:
    """Return the number of messages with samples of a bag, from its index.

    Raises
    ------
    BagError
        If the bag is missing or damaged, or has no samples.
    """
    with opened(Path(uri)) as bag:
        return bag.count(_chosen(bag, None))


def begin_date(uri: Path | str) -> str:
    """Return the instant at which a bag begins, UTC as ISO 8601 in whole seconds.

    It is empty where the bag's clock is not that of the world.
    """
    with opened(Path(uri)) as bag:
        begin_ns = int(bag.reader.start_time)
    begun = datetime.fromtimestamp(begin_ns // 10**9, timezone.utc)
    return begun.isoformat() if begun.year >= _FIRST_ROS_YEAR else ""


def signals_text(uri: Path | str) -> str:
    """Return in one line which signals a bag has to be named, and which it has by itself.

    Raises
    ------
    BagError
        If the bag is missing or damaged.
    """
    with opened(Path(uri)) as bag:
        text = f"{bag.path} has {numbers_in(bag)}"
        topics = [topic for topic, kind in bag.types.items() if kind == IO_SAMPLE]
        infos = [bag.channels(sibling(topic, "io_channels")) for topic in sorted(topics)]
    for info in filter(None, infos):
        names = f"{', '.join(info.inputs)} -> {', '.join(info.outputs)}"
        text += f"; without --input and --output it is read as {names}"
    return text


def fields_of(uri: Path | str) -> list[str]:
    """Return every number of a bag, as `channels.selection` takes it; errors as `signals_text`."""
    with opened(Path(uri)) as bag:
        return number_fields(bag)


def read_channels(uri: Path | str, selection: Selection, *, wrap: float | None = None) -> IoData:
    """Read numbers of any topics as the record of an experiment, from a bag of any ROS 2 program.

    The record has the period of the densest output; `common_grid` says how the others come to it.

    Parameters
    ----------
    uri : Path or str
        As in `read_bag`.
    selection : Selection
        Inputs and outputs, by `channels.selection`.
    wrap : float, optional
        As in `read_bag`.

    Raises
    ------
    BagError
        If the bag is missing or damaged, or does not hold these signals at common instants. An
        error about a topic or field lists those that there are.
    """
    with opened(Path(uri)) as bag:
        return selected(bag, selection, wrap)


def _chosen(bag: Bag, topic: str | None) -> str:
    chosen = bag.choose(topic)
    if chosen is None:
        raise BagError(
            f"{bag.path}: holds neither ArmState nor IoSample; topics: {numbers_in(bag)}; "
            "`flexarm identify` takes any of these as --input TOPIC.FIELD and --output TOPIC.FIELD"
        )
    return chosen


def _aligned(
    bag: Bag, topic: str, samples: Pieces, commands: Pieces, wrap: float | None
) -> Alignment:
    if bag.types[topic] == ARM_STATE:
        return arm_alignment(samples, commands, source=str(bag.path))
    channels = bag.channels(sibling(topic, "io_channels"))
    return io_alignment(samples, channels, source=str(bag.path), commands=commands, wrap=wrap)


def _set_points(
    bag: Bag, topic: str, outputs: Sequence[str]
) -> tuple[Recorded | None, tuple[str, ...]]:
    """Return the recorded set-points of a rig, and the outputs that they are for."""
    if bag.types[topic] == ARM_STATE:
        return bag.optional(sibling(topic, "reference"), REFERENCE), ()
    try:
        tracked = described(bag.text(sibling(topic, "rig_description"))).tracked
    except SettingError:  # none, or that of another version
        tracked = ()
    if not tracked or not set(without_dots(tracked)) <= set(outputs):
        return None, ()
    return bag.optional(sibling(topic, "io_reference"), REFERENCES), tracked


def _command_pieces(bag: Bag, topic: str) -> Iterable[Recorded]:
    command, kind = _commands_of(bag, topic)
    return bag.pieces(command) if bag.has(command, kind) else ()


def _commands_of(bag: Bag, topic: str) -> tuple[str, str]:
    """Return topic and type of the commands that answer the samples of a topic."""
    if bag.types[topic] == ARM_STATE:
        return sibling(topic, "command"), MOTOR_COMMAND
    return sibling(topic, "io_command"), IO_COMMAND
