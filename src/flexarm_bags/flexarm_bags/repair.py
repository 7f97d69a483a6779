"""Bag repair: every undamaged message of a damaged bag is copied into a new one.

An MCAP file of ours holds its messages in chunks, each with a checksum. With an undamaged index at
the end of the file each chunk is read by itself, and a damaged one costs its own messages only. A
truncated file has no index; its chunks are read one after the other, past the damaged ones.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from itertools import chain
from mmap import ACCESS_READ, mmap
from typing import TYPE_CHECKING

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema, Statistics
from mcap.stream_reader import get_chunk_data_stream

from flexarm_bags.layout import MAGIC, RECORD_START, CutError, parse, summary_of, walk
from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import MessageDefinition
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_core.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mcap.records import McapRecord

# Times, sizes and checksum of a chunk stand in front of the name of its compression.
_COMPRESSION = b"\x04\x00\x00\x00zstd"
_COMPRESSION_AT = RECORD_START.size + struct.calcsize("<QQQI")


@dataclass(frozen=True)
class RepairSummary:
    """Result of a repair.

    Attributes
    ----------
    bag : Path
        The new bag.
    messages : int
        Messages in it.
    damage : str
        What could not be read; empty when every message was undamaged.
    """

    bag: Path
    messages: int
    damage: str


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
    files = sorted(damaged.glob("*.mcap")) if damaged.is_dir() else [damaged]
    if not files:
        raise RecordingError(f"{damaged}: no .mcap file in there to repair")
    topics: dict[str, RecordedTopic] = {}
    for found, _ in _whole(files):
        topics.setdefault(found.name, found)
    if not topics:
        raise RecordingError(f"{damaged}: holds no whole message, nothing to repair")
    damage: list[str] = []
    with BagWriter(repaired, list(topics.values())) as bag:
        for topic, message in _whole(files, damage):
            bag.write(topic.name, message.data, message.log_time, message.publish_time)
        count = bag.message_count
    return RepairSummary(repaired, count, "; ".join(damage))


def _whole(
    files: list[Path], damage: list[str] | None = None
) -> Iterator[tuple[RecordedTopic, Message]]:
    """Yield the undamaged messages of each file, and note the damage."""
    for file in files:
        yield from _FileRepair(file, [] if damage is None else damage).messages()


class _FileRepair:
    """One file and its damage."""

    def __init__(self, file: Path, damage: list[str]) -> None:
        self._file = file
        self._damage = damage

    def messages(self) -> Iterator[tuple[RecordedTopic, Message]]:
        schemas: dict[int, Schema] = {}
        topics: dict[int, RecordedTopic] = {}
        count, announced = 0, None
        for record in self._contents():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel) and record.schema_id in schemas:
                try:
                    topics[record.id] = _topic(record, schemas[record.schema_id])
                except UnicodeDecodeError as error:
                    self._note(f"a definition is damaged: {one_line(error)}")
            elif isinstance(record, Message) and record.channel_id in topics:
                yield topics[record.channel_id], record
                count += 1
            elif isinstance(record, Statistics):
                announced = record.message_count
        if announced is not None and announced != count:
            self._note(f"{announced - count} of {announced} messages are lost")

    def _contents(self) -> Iterator[McapRecord]:
        """Yield the records, those in chunks among them.

        The definitions are repeated in the summary: the first chunk may be damaged.
        """
        if not self._file.stat().st_size:
            self._note("is empty")
            return
        with self._file.open("rb") as stream, mmap(stream.fileno(), 0, access=ACCESS_READ) as data:
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
        try:
            stream, length = get_chunk_data_stream(chunk, validate_crc=True)
            content = stream.read(length)
            parsed = [parse(opcode, content[start:end])[0] for opcode, start, end in walk(content)]
        except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
            self._note(f"a chunk is damaged: {_cause(error)}")
            return []
        return [record for record in parsed if record is not None]

    def _indexed(self, data: mmap, chunks: list[ChunkIndex]) -> Iterator[McapRecord]:
        for index in chunks:
            start = index.chunk_start_offset
            content = data[start + RECORD_START.size : start + index.chunk_length]
            if data[start] != Opcode.CHUNK:
                self._note("a chunk is damaged: its kind is overwritten")
                continue
            try:
                record, _ = parse(Opcode.CHUNK, content)
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
                    record, length = parse(opcode, data[start:end])
                    if record is not None:
                        yield record
                    if opcode == Opcode.FOOTER and data[end:] == MAGIC:
                        return
                    if record is not None and length != end - start:
                        self._note(f"the record at byte {at} does not have its length")
                        break
                else:
                    self._note("it ends in the middle")
            except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
                self._note(_cause(error))
            # Only a name in front of the compressed bytes tells where the next chunk may begin.
            at = data.find(_COMPRESSION, at + _COMPRESSION_AT + 1) - _COMPRESSION_AT

    def _note(self, text: str) -> None:
        self._damage.append(f"{self._file.name}: {text}")


def _cause(error: Exception) -> str:
    if isinstance(error, CutError | EndOfFile | struct.error):
        return "it ends in the middle"
    return one_line(error)


def _topic(channel: Channel, schema: Schema) -> RecordedTopic:
    latched = "transient_local" in channel.metadata.get("offered_qos_profiles", "")
    return RecordedTopic(
        channel.topic,
        MessageDefinition(
            schema.name, schema.data.decode(), channel.metadata.get("topic_type_hash", "")
        ),
        TopicQos(durability="transient_local" if latched else "volatile"),
    )
