"""Bag reading: the only module of this package that opens a bag.

The sampling period comes from the header stamps, the instants of sampling. References have no
header: they are ordered by log time, which our recorder sets to the instant of sending.
:mod:`flexarm_ident.reading.alignment` decides which input acts on which sample.
"""

from __future__ import annotations

import json
from datetime import datetime, timezone
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_bags.reader import (
    ARM_STATE,
    IO_COMMAND,
    IO_SAMPLE,
    LAW_IN_FORCE,
    MOTOR_COMMAND,
    REFERENCE,
    REFERENCES,
    opened,
    sibling,
)
from flexarm_core.clock import NS
from flexarm_core.errors import BagError, SettingError
from flexarm_core.labels import instant, without_dots
from flexarm_core.rig_description import described
from flexarm_ident.reading.alignment import BagStream, arm_alignment, io_alignment
from flexarm_ident.reading.channels import selected
from flexarm_ident.reading.fields import number_fields, numbers_in
from flexarm_ident.records.data_warning import PLANT_CHANGED, Grade
from flexarm_ident.records.span import part_options

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_bags.reader import Bag, Recorded
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.reading.alignment import Alignment, BagReading, Pieces
    from flexarm_ident.reading.channels import Selection
    from flexarm_ident.reading.timetable import Timetable
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

# Clocks that begin at 0 when a machine or a simulation starts are far below.
_FIRST_ROS_YEAR = 2007
PARAMETER_EVENT = "rcl_interfaces/msg/ParameterEvent"
_EVENTS = "/parameter_events"


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

    The record has the period of the densest output; `offsets` says how the others come to it.

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


def recorded_changes(
    bag: Bag, topic: str, samples: Recorded, table: Timetable
) -> tuple[DataWarning, ...]:
    """Return the warnings of a bag of our own rig, of the kind that `diagnostics.change` has.

    Each has the instant of its change, ``at_s``, seconds from the first row on.

    Parameters
    ----------
    bag : Bag
        The bag.
    topic : str
        Topic of the samples.
    samples : Recorded
        All messages of the topic.
    table : Timetable
        Places of the samples.
    """
    places, period_s = _Places(samples, table), table.grid.period_s
    found = []
    payloads = list(places.inside(_payloads(bag, topic), places.received_ns))
    at_s = [row * period_s for row, _ in payloads]
    sides = zip(payloads, [0.0, *at_s], at_s, [*at_s[1:], None], strict=False)
    for (row, text), since_s, cut_s, until_s in sides:
        before, after = part_options(since_s, cut_s), part_options(cut_s, until_s)
        said = (
            f"the payload was changed {text} at {instant(row, period_s)}: a model of both sides "
            f"mixes two arms; identify the parts separately ({before}, {after})"
        )
        found.append(PLANT_CHANGED(said, {"at_s": cut_s}))
    for row, text in places.inside(_laws(bag, topic), places.stamps_ns):
        said = f"the controller was changed {text} at {instant(row, period_s)}"
        figures = {"at_s": row * period_s}
        found.append(PLANT_CHANGED(said, figures, grade=Grade.INFORMATION))
    return tuple(found)


class _Places:
    """Rows of a record at the instants of its messages, rising."""

    def __init__(self, samples: Recorded, table: Timetable) -> None:
        self._rows = np.rint(table.grid.instants).astype(np.int64)
        self._count = table.rows
        self.received_ns, self.stamps_ns = (
            np.maximum.accumulate(each[table.run.messages][table.grid.kept])
            for each in (samples.log_times_ns, samples.stamps_ns())
        )

    def inside(
        self, changes: Iterable[tuple[int, str]], times_ns: NDArray[np.int64]
    ) -> Iterator[tuple[int, str]]:
        """Yield the row and the text of each change within the record."""
        for time_ns, text in changes:
            following = int(np.searchsorted(times_ns, time_ns))
            if 0 < following < len(self._rows) and self._rows[following] < self._count:
                yield int(self._rows[following]), text


def _payloads(bag: Bag, topic: str) -> Iterator[tuple[int, str]]:
    """Yield instant of receiving and new value of each change of the simulated arm's payload."""
    if not bag.has(_EVENTS, PARAMETER_EVENT) or not bag.count(_EVENTS):
        return
    node, before_kg = sibling(topic, "daq"), None
    messages = zip(
        bag.grouped(_EVENTS).log_times_ns.tolist(),
        bag.messages(_EVENTS, PARAMETER_EVENT),
        strict=True,
    )
    for time_ns, event in messages:
        if event.node != node:
            continue
        # A node that starts declares its own.
        for each in (*event.new_parameters, *event.changed_parameters):
            if each.name != "payload_kg":
                continue
            is_new, before_kg = each.value.double_value != before_kg, each.value.double_value
            # What is set to the value that it has is in the event as well.
            if is_new and each in event.changed_parameters:
                yield time_ns, f"to {before_kg:g} kg"


def _laws(bag: Bag, topic: str) -> Iterator[tuple[int, str]]:
    """Yield instant and new value of each change of the control law or of one of its parameters."""
    law = sibling(topic, "law")
    if not bag.has(law, LAW_IN_FORCE) or not bag.count(law):
        return
    messages = bag.messages(law, LAW_IN_FORCE)
    changes = [
        (NS * each.header.stamp.sec + each.header.stamp.nanosec, values)
        for each in messages
        if "law" in (values := _values(each.parameters))
    ]
    for (_, before), (time_ns, after) in pairwise(changes):
        if text := _difference(before, after):
            yield time_ns, text


def _values(text: str) -> dict[str, Any]:
    try:
        values = json.loads(text)
    except ValueError:
        return {}
    return values if isinstance(values, dict) else {}


def _difference(before: dict[str, Any], after: dict[str, Any]) -> str:
    """Return what differs of the law, in a few words.

    It is empty where only its reference differs, or models, which are reported where they are
    chosen.
    """
    if after["law"] != before["law"]:
        return f"to {after['law']}"
    references = tuple(f"{each.get('reference')}." for each in (before, after))
    of_others = ("models.", "shaper", "reference", "trajectory", *references)
    names = [
        name
        for name in before | after
        if not name.startswith(of_others) and before.get(name) != after.get(name)
    ]
    return f"in {', '.join(names)}" if names else ""
