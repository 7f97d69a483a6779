"""Bag repair: every undamaged message of a damaged bag is copied into a new one.

An MCAP file of ours holds its messages in chunks, each with a checksum. With an undamaged index at
the end of the file each chunk is read by itself, and a damaged one costs its own messages only. A
truncated file has no index; its chunks are read one after the other, past the damaged ones. Of a
chunk that the end of the file cuts, the first messages are there: they alone have no checksum.

A file holds each channel and schema twice, in a chunk and in its summary, and a channel has the
hash that its definition must have. A definition with a wrong letter would make the whole bag
unreadable.
"""

from __future__ import annotations

import struct
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, TypeVar

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema, Statistics
from rosbags.rosbag2.metadata import parse_qos

from flexarm_bags.metadata import RecordedTopic, TopicQos, in_order, plain_name, read_information
from flexarm_bags.records.layout import (
    CHUNK_BYTES,
    MAGIC,
    RECORD_START,
    CutError,
    chunk_content,
    chunk_records,
    chunk_sizes,
    fingerprint,
    has_its_length,
    mapped,
    parse,
    record_content,
    summary_of,
    unpacked_beginning,
    walk,
    whole_records,
)
from flexarm_bags.schema import CDR, MessageDefinition, text_hash
from flexarm_bags.writer import LATEST_TIME_NS, RecordingError, whole_bag
from flexarm_core.bounds import (
    BoundError,
    require_plain_file,
    too_much,
    unpacked_bytes_allowed,
    yaml_content,
)
from flexarm_core.errors import BagError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from mmap import mmap
    from pathlib import Path

    from mcap.records import McapRecord

# Times, sizes and checksum of a chunk stand in front of the name of its compression.
_COMPRESSION = b"\x04\x00\x00\x00zstd"
_CHUNK = bytes([Opcode.CHUNK])
_COMPRESSION_AT = RECORD_START.size + struct.calcsize("<QQQI")
_HASH, _QOS = "topic_type_hash", "offered_qos_profiles"


@dataclass(frozen=True)
class RepairSummary:
    """Result of a repair.

    Attributes
    ----------
    bag : Path
        The new bag.
    messages : int
        Messages in it.
    lost : int or None
        Messages of the damaged bag that are not in it; None where their number stands nowhere.
    damage : tuple of str
        What could not be read, one line each; empty when every message was undamaged.
    """

    bag: Path
    messages: int
    lost: int | None
    damage: tuple[str, ...]


def repair_bag(damaged: Path, repaired: Path) -> RepairSummary:
    """Copy every undamaged message of a damaged MCAP bag into a new bag.

    Parameters
    ----------
    damaged : Path
        rosbag2 folder or single `.mcap` file.
    repaired : Path
        Folder to create.

    Raises
    ------
    RecordingError
        When there is no MCAP file, no undamaged message, or the new bag cannot be written.
    """
    if not damaged.exists():
        raise RecordingError(f"{damaged}: no such bag")
    try:
        files = [_FileRepair(file) for file in _mcap_files(damaged)]
    except BoundError as error:
        raise RecordingError(str(error)) from error
    topics: dict[str, RecordedTopic] = {}
    for file in files:
        topics = {**file.survey(), **topics}
    if not topics:
        raise RecordingError(f"{damaged}: has no whole message of ROS 2, nothing to repair")
    with whole_bag(repaired, list(topics.values())) as bag:
        for file in files:
            for topic, message in file.messages(topics):
                bag.write(topic.name, message.data, message.log_time, message.publish_time)
        count = bag.message_count
    damage = tuple(line for file in files for line in file.damage())
    stated = _stated_messages(damaged, files)
    lost = None if damage and stated is None else max(0, (stated or count) - count)
    return RepairSummary(repaired, count, lost, damage)


def _mcap_files(damaged: Path) -> list[Path]:
    if not damaged.is_dir():
        if damaged.suffix != ".mcap":
            packed = plain_name(damaged.name) != damaged.name
            raise RecordingError(
                f"{damaged}: no bag of MCAP files: "
                + ("unpack it first (`zstd -d`)" if packed else "nothing else can be repaired")
            )
        return [damaged]
    files = in_order(damaged.glob("*.mcap"))
    if not files:
        raise RecordingError(f"{damaged}: no .mcap file in there to repair")
    return files


def _stated_messages(damaged: Path, files: Sequence[_FileRepair]) -> int | None:
    """Return the number of messages before the damage; None where it stands nowhere."""
    stated = [file.stated for file in files]
    if None not in stated:
        return sum(number for number in stated if number is not None)
    # A recorder that was killed leaves a zero there.
    with suppress(BagError):
        return int(read_information(damaged).get("message_count") or 0) or None
    return None


class _FileRepair:
    """One file, its damage, and the number of its messages where it has its statistics."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._allowed = unpacked_bytes_allowed(require_plain_file(file))
        self._left = self._allowed
        self._seen: set[tuple[int, ...]] = set()
        self._definitions = Definitions()
        self._topics: dict[int, RecordedTopic | None] = {}
        self._damage: Counter[str] = Counter()
        self.stated: int | None = None

    def damage(self) -> list[str]:
        """Return what could not be read, each kind once."""
        return [
            f"{self._file.name}: {text}" + (f" ({times} times)" if times > 1 else "")
            for text, times in self._damage.items()
        ]

    def survey(self) -> dict[str, RecordedTopic]:
        """Go through the file once; return the topics that have messages and a definition."""
        used: dict[int, None] = {}
        for record in self._contents():
            if isinstance(record, Schema):
                self._definitions.add_schema(record)
            elif isinstance(record, Channel):
                self._definitions.add_channel(record)
            elif isinstance(record, Message):
                used[record.channel_id] = None
            elif isinstance(record, Statistics):
                self.stated = record.message_count
        self._topics = {number: self._definitions.topic(number) for number in used}
        topics: dict[str, RecordedTopic] = {}
        for topic in self._topics.values():
            if topic is not None:
                topics.setdefault(topic.name, topic)
        return topics

    def messages(
        self, chosen: Mapping[str, RecordedTopic]
    ) -> Iterator[tuple[RecordedTopic, Message]]:
        """Yield the undamaged messages that have the chosen definition of their topic."""
        of_another = {
            number
            for number, topic in self._topics.items()
            if topic is not None and not _is_same(topic, chosen[topic.name])
        }
        for record in self._contents():
            if isinstance(record, Message):
                topic = self._topics.get(record.channel_id)
                if max(record.log_time, record.publish_time) > LATEST_TIME_NS:
                    self._note("a message whose time is beyond 2^63 ns is left out")
                elif record.channel_id in of_another:
                    self._note(
                        f"a message of {self._definitions.name(record.channel_id)} has another "
                        "definition than the first one, and is left out"
                    )
                elif topic is not None:
                    yield topic, record
                elif encoding := self._definitions.foreign(record.channel_id):
                    self._note(
                        f"a message of {self._definitions.name(record.channel_id)} is {encoding} "
                        "and none of ROS 2, and is left out"
                    )
                else:
                    self._note(
                        f"a message of {self._definitions.name(record.channel_id)}, whose "
                        "definition is damaged, is left out"
                    )

    def _contents(self) -> Iterator[McapRecord]:
        """Yield the records, those in chunks among them.

        The definitions are repeated in the summary: the first chunk may be damaged.
        """
        self._damage.clear()
        self._seen.clear()
        self._left = self._allowed
        if not self._file.stat().st_size:
            self._note("is empty")
            return
        with self._file.open("rb") as stream, mapped(stream) as data:
            try:
                summary = summary_of(stream)
            except Exception:  # noqa: BLE001 - parsers raise anything on damaged bytes
                summary = []
            chunks = [record for record in summary if isinstance(record, ChunkIndex)]
            records = chain(summary, self._indexed(data, chunks)) if chunks else self._all(data)
            for record in records:
                if isinstance(record, Chunk):
                    yield from self._inner(record)
                else:
                    yield record

    def _inner(self, chunk: Chunk) -> list[McapRecord]:
        seen = fingerprint(chunk)
        if seen in self._seen:
            self._note("a chunk is there twice")
            return []
        self._seen.add(seen)
        try:
            content = chunk_content(chunk).tobytes()
            parsed = [
                parse(opcode, content[start:end])[0]
                for opcode, start, end in chunk_records(content)
            ]
        except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
            self._note(f"a chunk is damaged: {_cause(error)}")
            return []
        self._left -= len(content)
        if self._left < 0:
            raise RecordingError(f"{self._file}: {too_much(self._allowed)}")
        return [record for record in parsed if record is not None]

    def _indexed(self, data: mmap, chunks: list[ChunkIndex]) -> Iterator[McapRecord]:
        for index in chunks:
            start = index.chunk_start_offset
            if start >= len(data) or data[start] != Opcode.CHUNK:
                self._note("a chunk is damaged: its kind is overwritten")
                continue
            try:
                end = start + index.chunk_length
                record, _ = parse(
                    Opcode.CHUNK, record_content(data, start + RECORD_START.size, end)
                )
            except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
                self._note(f"a chunk is damaged: {_cause(error)}")
            else:
                yield from [record] if record else []

    def _all(self, data: mmap) -> Iterator[McapRecord]:
        """Yield the records one after the other; after damage, from the next chunk on."""
        at, start, end = len(MAGIC), 0, 0
        while at >= 0:
            try:
                for opcode, start, end in walk(data, at):
                    at = start - RECORD_START.size
                    if opcode == Opcode.ATTACHMENT:
                        continue
                    record, length = parse(opcode, record_content(data, start, end))
                    if record is not None:
                        yield record
                    if opcode == Opcode.FOOTER and data[end : end + len(MAGIC)] == MAGIC:
                        return
                    if record is not None and length != end - start:
                        self._note(f"the record at byte {at} does not have its length")
                        break
                else:
                    self._note("it ends in the middle")
            except CutError as error:
                self._note(_cause(error))
                at = max(at, end)
                yield from self._begun(data, at)
            except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
                self._note(_cause(error))
            # Only a name in front of the compressed bytes says where the next chunk may begin.
            at = data.find(_COMPRESSION, at + _COMPRESSION_AT + 1) - _COMPRESSION_AT

    def _begun(self, data: mmap, at: int) -> list[McapRecord]:
        """Return the whole records of a chunk that the end of the file cuts."""
        start = at + RECORD_START.size
        chunk = chunk_sizes(data, start, len(data)) if data[at:start][:1] == _CHUNK else None
        if chunk is None or not has_its_length(data, chunk):
            return []
        if chunk.unpacked > min(self._left, CHUNK_BYTES):
            self._note(f"its last chunk says it has {chunk.unpacked >> 20} MB, and is left out")
            return []
        packed = data[chunk.packed_start : chunk.packed_end]
        try:
            content = unpacked_beginning(packed, chunk.compression, chunk.unpacked)
            parsed = [parse(kind, content[a:b])[0] for kind, a, b in whole_records(content)]
        except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
            self._note(f"its last chunk is damaged: {_cause(error)}")
            return []
        self._left -= len(content)
        if count := sum(isinstance(record, Message) for record in parsed):
            self._note(f"its last chunk is cut: the first messages of it, {count}, are unchecked")
        return [record for record in parsed if record is not None]

    def _note(self, text: str) -> None:
        self._damage[text] += 1


def _is_same(topic: RecordedTopic, other: RecordedTopic) -> bool:
    """Return whether two topics have one definition, whatever its comments."""
    one, two = topic.definition, other.definition
    if (one.type_name, one.text) == (two.type_name, two.text):
        return True
    return text_hash(one.type_name, one.text) == text_hash(two.type_name, two.text)


def _cause(error: Exception) -> str:
    if isinstance(error, CutError | EndOfFile | struct.error):
        return "it ends in the middle"
    return one_line(error)


@dataclass
class Definitions:
    """Copies of the channels and schemas of a file, in the order in which they were found.

    Attributes
    ----------
    channels, schemas : dict of int to list
        Different copies by their number, each with its number of occurrences.
    """

    channels: dict[int, list[tuple[Channel, int]]] = field(default_factory=dict)
    schemas: dict[int, list[tuple[Schema, int]]] = field(default_factory=dict)

    def add_channel(self, channel: Channel) -> None:
        """Keep a copy of a channel."""
        self.channels[channel.id] = _counted(self.channels.get(channel.id, []), channel)

    def add_schema(self, schema: Schema) -> None:
        """Keep a copy of a schema."""
        self.schemas[schema.id] = _counted(self.schemas.get(schema.id, []), schema)

    def name(self, number: int) -> str:
        """Return the topic of a channel, whole or not, for messages."""
        copies = self.channels.get(number)
        return copies[0][0].topic if copies else f"the unknown channel {number}"

    def foreign(self, number: int) -> str:
        """Return the encoding of a channel whose messages are none of ROS 2; else empty."""
        encodings = {channel.message_encoding for channel, _ in self.channels.get(number, [])}
        return "" if CDR in encodings else ", ".join(sorted(encodings))

    def topic(self, number: int) -> RecordedTopic | None:
        """Return the topic of a channel with an undamaged definition; None without one.

        A definition is whole when it has the hash that a copy of its channel states. Where none
        has, all its copies must be equal, two or more of them if a hash is stated.
        """
        for channel, _ in self.channels.get(number, []):
            copies = self.schemas.get(channel.schema_id, [])
            stated = channel.metadata.get(_HASH, "")
            found = [(schema, definition_hash(schema)) for schema, _ in copies]
            for schema, its_hash in found:
                if its_hash == stated:
                    return _topic(channel, schema, stated)
            if len(copies) == 1 and found[0][1] is not None and (copies[0][1] > 1 or not stated):
                return _topic(channel, found[0][0], found[0][1] if stated else "")
        return None


_CopyT = TypeVar("_CopyT")


def _counted(copies: list[tuple[_CopyT, int]], new: _CopyT) -> list[tuple[_CopyT, int]]:
    if not any(copy == new for copy, _ in copies):
        return [*copies, (new, 1)]
    return [(copy, count + (copy == new)) for copy, count in copies]


def definition_hash(schema: Schema) -> str | None:
    """Return the hash of a definition, ``RIHS01_...``; None when it cannot be read."""
    try:
        return text_hash(schema.name, schema.data.decode())
    except Exception:  # noqa: BLE001 - parsers raise anything on damaged bytes
        return None


def _topic(channel: Channel, schema: Schema, type_hash: str) -> RecordedTopic:
    definition = MessageDefinition(schema.name, schema.data.decode(), type_hash)
    return RecordedTopic(channel.topic, definition, _qos(channel.metadata.get(_QOS, "")))


def _qos(text: str) -> TopicQos:
    try:
        return TopicQos.of(parse_qos(yaml_content(text)))  # type: ignore[arg-type]
    except Exception:  # noqa: BLE001 - parsers raise anything on damaged bytes
        return TopicQos()
