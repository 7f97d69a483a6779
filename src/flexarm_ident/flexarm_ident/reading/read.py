"""Bags as records of experiments: the only file of this package that opens a bag.

How times are chosen: the sampling period comes from the header stamps, the instants of sampling.
References have no header: they are ordered by log time, which our recorder sets to the instant of
sending. Which input acts on which sample is decided in :mod:`flexarm_ident.alignment`.
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import numpy as np
import yaml
from rosbags.highlevel import AnyReader

from flexarm_ident.alignment import (
    BagReading,
    Channels,
    Recorded,
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
from flexarm_ident.bag_stream import leading_rows, open_stream
from flexarm_ident.cdr import CdrError, decode, members
from flexarm_ident.errors import DataError, IdentificationError
from flexarm_ident.loop_kind import loop_kind
from flexarm_ident.mcap_chunks import (
    Messages,
    NotIndexedError,
    read_topic,
    topic_pieces,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.bag_stream import BagStream
    from flexarm_ident.iodata import IoData

ARM_STATE = "flexarm_msgs/msg/ArmState"
IO_SAMPLE = "flexarm_msgs/msg/IoSample"
CHANNEL_INFO = "flexarm_msgs/msg/ChannelInfo"
MOTOR_COMMAND = "flexarm_msgs/msg/MotorCommand"
COMMANDER_INFO = "flexarm_msgs/msg/CommanderInfo"
REFERENCE = "std_msgs/msg/Float64"


class BagError(IdentificationError):
    """A bag cannot be read as the record of an experiment."""


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
    with _opened(path) as bag:
        chosen = bag.choose(topic)
        if bag.types[chosen] == ARM_STATE:
            return arm_reading(
                bag.recorded(chosen),
                bag.optional(_sibling(chosen, "reference"), REFERENCE),
                partial(bag.every, _sibling(chosen, "command"), MOTOR_COMMAND),
                declared=bag.declared_loops(chosen),
                source=str(path),
            )
        return io_reading(
            bag.recorded(chosen), bag.channels(_sibling(chosen, "io_channels")), source=str(path)
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
    with _opened(path) as bag:
        chosen = bag.choose(topic)
        is_arm = bag.types[chosen] == ARM_STATE
        found = marks(bag.pieces(chosen))
        if is_arm:
            command = _sibling(chosen, "command")
            commanded = bag.has(command, MOTOR_COMMAND)
            table = arm_timetable(found, lambda: bag.pieces(command) if commanded else ())
            header, declared = arm_header(table, source), bag.declared_loops(chosen)
        else:
            table = io_timetable(found)
            first = next(bag.pieces(chosen))
            widths = (first.real("inputs").shape[1], first.real("outputs").shape[1])
            header = io_header(table, bag.channels(_sibling(chosen, "io_channels")), widths, source)

    def rows() -> Iterator[tuple[FloatArray, FloatArray]]:
        with _opened(path) as bag:
            if not is_arm:
                yield from io_rows(table, bag.pieces(chosen))
                return
            for u, y in arm_rows(table, bag.pieces(chosen)):
                yield u[:, :1] - u[:, 1:], y

    def judged(samples: int) -> IoData:
        with _opened(path) as bag:
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
    with _opened(Path(uri)) as bag:
        return bag.count(bag.choose(topic))


@contextmanager
def _opened(path: Path) -> Iterator[_Bag]:
    """Open a bag; whatever the parsers raise on a damaged one becomes one line."""
    _require_bag(path)
    try:
        with AnyReader([path]) as reader:
            yield _Bag(path, reader, _plain_mcap_files(path))
    except BagError:
        raise
    except DataError as error:
        message = str(error)
        raise BagError(
            message if message.startswith(str(path)) else f"{path}: {message}"
        ) from error
    except Exception as error:
        cause = " ".join(str(error).split()) or type(error).__name__
        raise BagError(
            f"{path}: truncated or damaged: {cause}; try `flexarm bag repair {path} -o NEW`"
        ) from error


def _require_bag(path: Path) -> None:
    if not path.exists():
        raise BagError(f"{path}: no such bag")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise BagError(f"{path}: no bag: the folder has no metadata.yaml")
    elif path.suffix not in {".mcap", ".db3"}:
        raise BagError(f"{path}: no bag: expected a rosbag2 folder or a .mcap or .db3 file")


def _plain_mcap_files(path: Path) -> tuple[Path, ...]:
    """Return the files whose chunks can be read directly; none when rosbag2 compressed them."""
    if not path.is_dir():
        return (path,) if path.suffix == ".mcap" else ()
    content = yaml.safe_load((path / "metadata.yaml").read_text("utf-8"))
    information = content["rosbag2_bagfile_information"]
    compressed = (information.get("compression_mode") or "none").lower() != "none"
    if information["storage_identifier"] != "mcap" or compressed:
        return ()
    return tuple(path / PurePath(name).name for name in information["relative_file_paths"])


def _sibling(topic: str, name: str) -> str:
    return f"{topic.rpartition('/')[0]}/{name}"


@dataclass(frozen=True)
class _Bag:
    """An open bag."""

    path: Path
    reader: AnyReader
    mcap_files: tuple[Path, ...]

    @property
    def types(self) -> dict[str, str]:
        return {entry.topic: entry.msgtype for entry in self.reader.connections}

    def count(self, topic: str) -> int:
        return sum(entry.msgcount for entry in self.reader.connections if entry.topic == topic)

    def has(self, topic: str, type_name: str) -> bool:
        return self.types.get(topic) == type_name and self.count(topic) > 0

    def choose(self, topic: str | None) -> str:
        types = self.types
        listed = ", ".join(f"{name} ({types[name]})" for name in sorted(types)) or "none"
        if topic is not None:
            if types.get(topic) not in {ARM_STATE, IO_SAMPLE}:
                raise BagError(f"{self.path}: {topic} holds no samples; topics: {listed}")
            return topic
        for wanted in (ARM_STATE, IO_SAMPLE):
            found = sorted(name for name, type_name in types.items() if type_name == wanted)
            if len(found) > 1:
                raise BagError(f"{self.path}: choose one topic of {', '.join(found)}")
            if found:
                return found[0]
        raise BagError(f"{self.path}: neither ArmState nor IoSample in there; topics: {listed}")

    def optional(self, topic: str, type_name: str) -> Recorded | None:
        """Return all messages of a topic as columns; None when there are none of that type."""
        return self.recorded(topic) if self.has(topic, type_name) else None

    def every(self, topic: str, type_name: str) -> list[Recorded]:
        """Return all messages of a topic, none or one piece."""
        found = self.optional(topic, type_name)
        return [] if found is None else [found]

    def declared_loops(self, topic: str) -> list[bool]:
        """Return of everybody who commanded, and said so, whether the outputs were used."""
        commander = _sibling(topic, "commander")
        if not self.has(commander, COMMANDER_INFO):
            return []
        connections = [entry for entry in self.reader.connections if entry.topic == commander]
        infos = (
            self.reader.deserialize(raw, COMMANDER_INFO)
            for _, _, raw in self.reader.messages(connections)
        )
        # The member is generated from the bag's own definition.
        return [bool(getattr(info, "uses_outputs")) for info in infos]  # noqa: B009

    def recorded(self, topic: str) -> Recorded:
        """Return all messages of a topic as columns."""
        messages = self._chunked_messages(topic)
        if messages is None:
            messages = self._single_messages(topic)
        if not len(messages.log_times_ns):
            raise BagError(f"{self.path}: no messages on {topic}")
        layout = members(self.types[topic], self.reader.typestore.fielddefs)
        try:
            columns = decode(messages.groups, layout)
        except CdrError as error:
            raise BagError(f"{self.path}: {topic}: {error}") from error
        return Recorded(messages.log_times_ns, columns)

    def pieces(self, topic: str) -> Iterator[Recorded]:
        """Return the messages of a topic as columns, chunk by chunk of the file."""
        if not self.mcap_files:
            raise BagError(f"{self.path}: only a plain MCAP bag can be read piece by piece")
        layout = members(self.types[topic], self.reader.typestore.fielddefs)
        with ExitStack() as stack:
            streams = [stack.enter_context(file.open("rb")) for file in self.mcap_files]
            try:
                for messages in topic_pieces(streams, topic):
                    yield Recorded(messages.log_times_ns, decode(messages.groups, layout))
            except NotIndexedError as error:
                raise BagError(f"{self.path}: {error}: read it as a whole") from error

    def channels(self, topic: str) -> Channels | None:
        """Return the last ChannelInfo of a topic, None when there is none."""
        if self.types.get(topic) != CHANNEL_INFO:
            return None
        connections = [entry for entry in self.reader.connections if entry.topic == topic]
        info = None
        for _, _, raw in self.reader.messages(connections):
            info = self.reader.deserialize(raw, CHANNEL_INFO)
        if info is None:
            return None
        return Channels(
            tuple(getattr(info, "input_names")),  # noqa: B009 - generated from the bag's definition
            tuple(getattr(info, "output_names")),  # noqa: B009
            rate_hz=float(getattr(info, "sampling_rate_hz")),  # noqa: B009
            closed_loop=bool(getattr(info, "closed_loop")),  # noqa: B009
            source=str(getattr(info, "source")),  # noqa: B009
        )

    def _chunked_messages(self, topic: str) -> Messages | None:
        """Return None when the files are not fully chunked and indexed."""
        if not self.mcap_files:
            return None
        with ExitStack() as stack:
            streams = [stack.enter_context(file.open("rb")) for file in self.mcap_files]
            return read_topic(streams, topic)

    def _single_messages(self, topic: str) -> Messages:
        connections = [entry for entry in self.reader.connections if entry.topic == topic]
        times_ns: list[int] = []
        raws: list[bytes] = []
        for _, time_ns, raw in self.reader.messages(connections):
            times_ns.append(time_ns)
            raws.append(raw)
        sizes = np.array([len(raw) for raw in raws], dtype=np.int64)
        groups = []
        for size in np.unique(sizes).tolist():
            numbers = np.flatnonzero(sizes == size)
            joined = b"".join(raws[number] for number in numbers)
            groups.append((numbers, np.frombuffer(joined, np.uint8).reshape(-1, size)))
        return Messages(np.array(times_ns, dtype=np.int64), groups)
