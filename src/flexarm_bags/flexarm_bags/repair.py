"""Repair of a damaged bag: every whole message is copied into a new one.

What an MCAP file of ours holds is in chunks, each with a checksum. Where the index at the end of
the file is whole, each chunk is read by itself, and a damaged one costs its own messages only. A
file that was cut has no index; its chunks are read one after the other, as far as they go.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from io import SEEK_END, BytesIO
from itertools import chain
from typing import TYPE_CHECKING, BinaryIO

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import MessageDefinition
from flexarm_bags.writer import BagWriter, RecordingError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# Opcode, length, two offsets and a checksum, and the magic that ends the file.
_FOOTER = struct.Struct("<BQQQI8s")
_MAGIC = b"\x89MCAP0\r\n"
_CHECKSUM_BYTES = 4


@dataclass(frozen=True)
class RepairSummary:
    """What a repair brought back.

    Attributes
    ----------
    bag
        The new bag.
    messages
        Messages in it.
    damage
        What could not be read; empty when every message was whole.
    """

    bag: Path
    messages: int
    damage: str


def repair_bag(damaged: Path, repaired: Path) -> RepairSummary:
    """Copy every whole message of a damaged MCAP bag into a new bag.

    Parameters
    ----------
    damaged
        rosbag2 folder or single `.mcap` file.
    repaired
        Folder to create.

    Returns
    -------
    RepairSummary
        How many messages there were and what the damage was.

    Raises
    ------
    RecordingError
        When there is no MCAP file, nothing whole in it, or the new bag cannot be written.
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
    """Yield the whole messages of each file; what is not whole is noted."""
    for file in files:
        yield from _FileRepair(file, [] if damage is None else damage).messages()


class _FileRepair:
    """One file, and what is wrong with it."""

    def __init__(self, file: Path, damage: list[str]) -> None:
        self._file = file
        self._damage = damage

    def messages(self) -> Iterator[tuple[RecordedTopic, Message]]:
        schemas: dict[int, Schema] = {}
        topics: dict[int, RecordedTopic] = {}
        count, announced = 0, None
        with self._file.open("rb") as stream:
            for record in self._contents(stream):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel) and record.schema_id in schemas:
                    try:
                        topics[record.id] = _topic(record, schemas[record.schema_id])
                    except UnicodeDecodeError as error:
                        self._note(f"a definition is damaged: {_cause(error)}")
                elif isinstance(record, Message) and record.channel_id in topics:
                    yield topics[record.channel_id], record
                    count += 1
                elif isinstance(record, Statistics):
                    announced = record.message_count
        if announced is not None and announced != count:
            self._note(f"{announced - count} of {announced} messages are lost")

    def _contents(self, stream: BinaryIO) -> Iterator[McapRecord]:
        """Yield the records, those in chunks among them.

        The definitions are repeated in the summary: the first chunk may be damaged.
        """
        summary = _summary(stream)
        chunks = [record for record in summary if isinstance(record, ChunkIndex)]
        records = chain(summary, self._indexed(stream, chunks)) if chunks else self._all(stream)
        for record in records:
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                inner = breakup_chunk(record, validate_crc=True)
            except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
                self._note(f"a chunk is damaged: {_cause(error)}")
            else:
                yield from inner

    def _indexed(self, stream: BinaryIO, chunks: list[ChunkIndex]) -> Iterator[McapRecord]:
        for index in chunks:
            stream.seek(index.chunk_start_offset)
            reader = StreamReader(
                stream, skip_magic=True, emit_chunks=True, record_size_limit=index.chunk_length
            )
            try:
                record = next(reader.records)
            except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
                self._note(f"a chunk is damaged: {_cause(error)}")
                continue
            if isinstance(record, Chunk):
                yield record
            else:
                self._note("a chunk is damaged: its kind is overwritten")

    def _all(self, stream: BinaryIO) -> Iterator[McapRecord]:
        """Yield the records one after the other, as far as they can be told apart."""
        stream.seek(len(_MAGIC))
        limit = self._file.stat().st_size
        reader = StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=limit)
        try:
            yield from reader.records
        except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
            self._note(_cause(error))

    def _note(self, text: str) -> None:
        self._damage.append(f"{self._file.name}: {text}")


def _cause(error: Exception) -> str:
    if isinstance(error, (EndOfFile, struct.error)):
        return "it ends in the middle"
    return " ".join(str(error).split()) or type(error).__name__


def _summary(stream: BinaryIO) -> list[McapRecord]:
    """Return the records behind the data; nothing when they are not there or damaged."""
    size = stream.seek(0, SEEK_END)
    if size < _FOOTER.size:
        return []
    stream.seek(-_FOOTER.size, SEEK_END)
    kind, _, start, _, checksum, magic = _FOOTER.unpack(stream.read(_FOOTER.size))
    if kind != Opcode.FOOTER or magic != _MAGIC or not 0 < start < size:
        return []
    stream.seek(start)
    raw = stream.read()
    if checksum and zlib.crc32(raw[: -_CHECKSUM_BYTES - len(_MAGIC)]) != checksum:
        return []
    try:
        return list(StreamReader(BytesIO(raw), skip_magic=True).records)
    except Exception:  # noqa: BLE001 - parsers raise anything on damaged bytes
        return []


def _topic(channel: Channel, schema: Schema) -> RecordedTopic:
    latched = "transient_local" in channel.metadata.get("offered_qos_profiles", "")
    return RecordedTopic(
        channel.topic,
        MessageDefinition(
            schema.name, schema.data.decode(), channel.metadata.get("topic_type_hash", "")
        ),
        TopicQos(durability="transient_local" if latched else "volatile"),
    )
