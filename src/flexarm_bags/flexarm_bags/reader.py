"""Open bags: their topics, and the messages of one topic as columns.

`opened` gives a `Bag`, and its `recorded` or `pieces` give the messages of a topic as `Recorded`.
The chunks of a plain MCAP file are read directly, many messages at a time (`chunks`). rosbags reads
everything else, message by message: SQLite, compressed bags and files without an index.
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.reader import NonSeekingReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_typestore

from flexarm_bags.bounds import (
    allowed_bytes,
    bounded,
    is_compressed,
    require_bounded_messages,
    require_honest_chunks,
    storages,
)
from flexarm_bags.metadata import parts_of, repair_advice
from flexarm_bags.records.chunks import (
    IndexedFile,
    Messages,
    NotIndexedError,
    read_topic,
    topic_pieces,
)
from flexarm_bags.records.columns import CdrError, alike, decode, members
from flexarm_bags.schema import DefinitionError, ros_messages
from flexarm_core.bounds import BoundError
from flexarm_core.errors import BagError, DataError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_bags.records.columns import Column, Member
    from flexarm_core.arrays import FloatArray

ARM_STATE = "flexarm_msgs/msg/ArmState"
IO_SAMPLE = "flexarm_msgs/msg/IoSample"
IO_COMMAND = "flexarm_msgs/msg/IoCommand"
CHANNEL_INFO = "flexarm_msgs/msg/ChannelInfo"
MOTOR_COMMAND = "flexarm_msgs/msg/MotorCommand"
COMMANDER_INFO = "flexarm_msgs/msg/CommanderInfo"
LAW_IN_FORCE = "flexarm_msgs/msg/LawInForce"
REFERENCE = "std_msgs/msg/Float64"
REFERENCES = "std_msgs/msg/Float64MultiArray"
TEXT = "std_msgs/msg/String"

_NS = 1_000_000_000
# What a message that is read by itself takes beside its bytes.
_OBJECT_BYTES = 256


def sibling(topic: str, name: str) -> str:
    """Return the topic of another name in the same namespace."""
    return f"{topic.rpartition('/')[0]}/{name}"


@dataclass(frozen=True)
class Recorded:
    """The messages of one topic as columns.

    Attributes
    ----------
    log_times_ns : ndarray of int, (messages,)
        Instants of sending.
    columns : mapping of str to ndarray
        Member name -> values, first axis messages.
    """

    log_times_ns: NDArray[np.int64]
    columns: Mapping[str, Column]

    def __len__(self) -> int:
        return len(self.log_times_ns)

    def real(self, name: str) -> FloatArray:
        """Return a column as floating point; DataError when the message type has no such member."""
        return np.asarray(self._column(name), dtype=np.float64)

    def integer(self, name: str) -> NDArray[np.int64]:
        """Return a column as integers; DataError when the message type has no such member."""
        return np.asarray(self._column(name)).astype(np.int64)

    def stamps_ns(self) -> NDArray[np.int64]:
        """Return the instants in the headers."""
        return self.integer("header.stamp.sec") * _NS + self.integer("header.stamp.nanosec")

    def has(self, name: str) -> bool:
        """Return whether the recorded message type has such a member."""
        return name in self.columns

    def _column(self, name: str) -> Column:
        if name not in self.columns:
            raise DataError(f"the recorded messages have no member {name}")
        return self.columns[name]


@dataclass(frozen=True)
class Grouped:
    """The messages of one topic of any type, in groups whose texts and sequences are as long.

    Attributes
    ----------
    log_times_ns : ndarray of int, (messages,)
        Instants of receiving, or of sending where the recorder knew it.
    groups : sequence of (ndarray of int, (n,), mapping of str to ndarray)
        Message numbers, and their columns as `columns.alike` names them.
    """

    log_times_ns: NDArray[np.int64]
    groups: Sequence[tuple[NDArray[np.intp], Mapping[str, Column]]]

    def __len__(self) -> int:
        return len(self.log_times_ns)


@dataclass(frozen=True)
class Channels:
    """Meaning of the arrays of IoSample, from ChannelInfo."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rate_hz: float
    closed_loop: bool
    source: str


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """Open a rosbag2 folder, its files without metadata, or a single ``.mcap`` or ``.db3`` file.

    Raises
    ------
    BagError
        If the bag is missing or damaged: one line for anything that the parsers raise, here or
        while the bag is open.
    """
    try:
        with ExitStack() as stack:
            plain = [stack.enter_context(bounded(each)) for each in parts_of(path)]
            plain = [stack.enter_context(ros_messages(each)) for each in plain]
            # Databases of older recorders have no definitions.
            common = get_typestore(Stores.ROS2_JAZZY)
            reader = stack.enter_context(AnyReader(plain, default_typestore=common))
            require_bounded_messages(reader)
            streams = [stack.enter_context(file.open("rb")) for file in _plain_mcap_files(reader)]
            yield Bag(path, reader, tuple(IndexedFile(stream) for stream in streams))
    except (BagError, DataError, BoundError, DefinitionError) as error:
        # Some of these begin with the bag already.
        raise BagError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error
    except ImportError as error:
        raise BagError(f"{path}: {one_line(error)}: part of a library, install again") from error
    except Exception as error:
        raise BagError(
            f"{path}: truncated or damaged: {one_line(error).rstrip('.')}{repair_advice(path)}"
        ) from error


def _plain_mcap_files(reader: AnyReader) -> list[Path]:
    """Return the MCAP files whose chunks can be read directly: all files of the bag, or none."""
    parts = storages(reader)
    plain = [Path(str(part.path)) for part in parts if isinstance(part, McapReader)]
    return [] if is_compressed(reader) or len(plain) < len(parts) else plain


@dataclass(frozen=True)
class Bag:
    """An open bag.

    Attributes
    ----------
    path : Path
        Its folder or file.
    reader : AnyReader
        Its messages one by one.
    files : tuple of IndexedFile
        Its MCAP files, where their chunks can be read directly; otherwise none.
    """

    path: Path
    reader: AnyReader
    files: tuple[IndexedFile, ...]

    @property
    def types(self) -> dict[str, str]:
        """Message type of each topic."""
        return {entry.topic: entry.msgtype for entry in self.reader.connections}

    def count(self, topic: str) -> int:
        """Return the number of messages of a topic, from the index."""
        return sum(entry.msgcount for entry in self.reader.connections if entry.topic == topic)

    def has(self, topic: str, type_name: str) -> bool:
        """Return whether a topic has messages of a type."""
        return self.types.get(topic) == type_name and self.count(topic) > 0

    def choose(self, topic: str | None) -> str | None:
        """Return the topic of the samples: the one asked for, or the only one, ArmState first.

        It is None when none was asked for and there is none.

        Raises
        ------
        BagError
            If the topic asked for has no samples, or more than one topic does.
        """
        types = self.types
        if topic is not None:
            if types.get(topic) not in {ARM_STATE, IO_SAMPLE}:
                listed = ", ".join(f"{name} ({types[name]})" for name in sorted(types)) or "none"
                raise BagError(f"{self.path}: {topic} has no samples; topics: {listed}")
            return topic
        for wanted in (ARM_STATE, IO_SAMPLE):
            found = sorted(name for name, type_name in types.items() if type_name == wanted)
            if len(found) > 1:
                raise BagError(f"{self.path}: choose one topic of {', '.join(found)}")
            if found:
                return found[0]
        return None

    def recorded(self, topic: str) -> Recorded:
        """Return all messages of a topic as columns.

        Raises
        ------
        BagError
            If there are none, or they do not follow their definition.
        """
        return self._decoded(topic, self._messages(topic))

    def grouped(self, topic: str) -> Grouped:
        """Return all messages of a topic of any type, in groups.

        Raises
        ------
        BagError
            If there are none, their type is unknown, or they do not follow its definition.
        """
        return self._grouped(topic, self._messages(topic).in_order())

    def first(self, topic: str) -> Grouped:
        """Return the first message of a topic of any type alone; errors as in `grouped`."""
        try:
            found = next(topic_pieces(self.files, topic), None) if self.files else None
        except NotIndexedError:
            found = None
        return self._grouped(topic, (found or self._messages(topic)).first())

    def optional(self, topic: str, type_name: str) -> Recorded | None:
        """Return all messages of a topic as columns; None when there are none of that type."""
        return self.recorded(topic) if self.has(topic, type_name) else None

    def every(self, topic: str, type_name: str) -> list[Recorded]:
        """Return all messages of a topic, none or one piece."""
        found = self.optional(topic, type_name)
        return [] if found is None else [found]

    def pieces(self, topic: str) -> Iterator[Recorded]:
        """Yield the messages of a topic as columns, chunk by chunk of the file.

        Raises
        ------
        BagError
            If the chunks cannot be read directly, or messages do not follow their definition.
        """
        if not self.files:
            raise BagError(f"{self.path}: only a plain MCAP bag can be read piece by piece")
        try:
            for messages in topic_pieces(self.files, topic):
                yield self._decoded(topic, messages)
        except NotIndexedError as error:
            raise BagError(f"{self.path}: {error}: read it as a whole") from error

    def channels(self, topic: str) -> Channels | None:
        """Return the last ChannelInfo of a topic, None when there is none."""
        if self.types.get(topic) != CHANNEL_INFO:
            return None
        if not self.count(topic):
            return None
        info = self.messages(topic, CHANNEL_INFO)[-1]
        return Channels(
            tuple(info.input_names),
            tuple(info.output_names),
            rate_hz=float(info.sampling_rate_hz),
            closed_loop=bool(info.closed_loop),
            source=str(info.source),
        )

    def text(self, topic: str) -> str:
        """Return the last text of a topic, empty when there is none."""
        return str(self.messages(topic, TEXT)[-1].data) if self.has(topic, TEXT) else ""

    def declared_loops(self, topic: str) -> list[bool]:
        """Return for each declared commander whether it used the outputs."""
        commander = sibling(topic, "commander")
        if not self.has(commander, COMMANDER_INFO):
            return []
        infos = self.messages(commander, COMMANDER_INFO)
        return [bool(info.uses_outputs) for info in infos]

    def _decoded(self, topic: str, messages: Messages) -> Recorded:
        """Return messages of a topic as columns, by the bag's own definition of their type."""
        try:
            return Recorded(messages.log_times_ns, decode(messages.groups, self._layout(topic)))
        except CdrError as error:
            raise BagError(f"{self.path}: {topic}: {error}") from error

    def _grouped(self, topic: str, messages: Messages) -> Grouped:
        try:
            groups = list(alike(messages.groups, self._layout(topic)))
        except CdrError as error:
            raise BagError(f"{self.path}: {topic}: {error}") from error
        return Grouped(messages.log_times_ns, groups)

    def _layout(self, topic: str) -> tuple[Member, ...]:
        return members(self.types[topic], self.reader.typestore.fielddefs)

    def _messages(self, topic: str) -> Messages:
        """Return the messages of a topic, as bytes."""
        messages = read_topic(self.files, topic) if self.files else None
        if messages is None:
            messages = self._one_by_one(topic)
        if not len(messages.log_times_ns):
            # The summary may lack the indexes or the channels, which rosbags goes by.
            messages = self._streamed(topic)
        if not len(messages.log_times_ns):
            raise BagError(f"{self.path}: no messages on {topic}")
        return messages

    def _streamed(self, topic: str) -> Messages:
        """Return the messages of a topic, read through the whole files."""
        allowed = allowed_bytes(self.reader)
        times_ns, raws = [], []
        for file in self.files:
            require_honest_chunks(file.stream)
            file.stream.seek(0)
            for _, channel, message in NonSeekingReader(file.stream).iter_messages([topic]):
                if channel.topic == topic:
                    times_ns.append(message.log_time)
                    raws.append(message.data)
                    allowed -= len(message.data) + _OBJECT_BYTES
                if allowed < 0:
                    raise BoundError(f"{topic} has too many messages to be read one by one")
        return Messages.of(times_ns, raws)

    def _one_by_one(self, topic: str) -> Messages:
        """Return the messages of a topic, read one by one."""
        for file in self.files:
            require_honest_chunks(file.stream)
        connections = [entry for entry in self.reader.connections if entry.topic == topic]
        allowed = allowed_bytes(self.reader)
        times_ns, raws = [], []
        for _, time_ns, raw in self.reader.messages(connections):
            times_ns.append(time_ns)
            raws.append(raw)
            allowed -= len(raw) + _OBJECT_BYTES
            if allowed < 0:
                raise BoundError(f"{topic} has too many messages to be read one by one")
        return Messages.of(times_ns, raws)

    def messages(self, topic: str, type_name: str) -> list[Any]:
        """Return the messages of a topic as objects, whose members the bag's definition names."""
        return [self.reader.deserialize(raw, type_name) for raw in self._messages(topic).raws()]
