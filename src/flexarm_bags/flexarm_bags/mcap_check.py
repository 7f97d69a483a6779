"""MCAP file integrity check.

Every record is visited, and everything that is stored twice is compared: checksums, indexes,
counts and times. A file of the project's own writer has three kinds of checksum, which cover every
byte between the magic numbers: of each chunk, of the data section and of the summary. Other
writers leave some out; then a note names what nothing protects.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple
from zlib import crc32

import numpy as np
from mcap import records
from mcap.opcode import Opcode

from flexarm_bags.records.chunks import Messages, gathered, heads_at
from flexarm_bags.records.layout import (
    CHECKSUM,
    INDEX_ENTRY,
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
    walk,
)
from flexarm_core.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Iterator
    from mmap import mmap
    from pathlib import Path

    from numpy.typing import NDArray


class TopicMessages(NamedTuple):
    """Some messages of one topic, in the order of the file."""

    topic: str
    messages: Messages


class _ChunkSeen(NamedTuple):
    """Facts of a chunk that its index repeats."""

    length: int
    compression: str
    sizes: tuple[int, int]
    times_ns: tuple[int, int]


@dataclass
class McapExamination:
    """Findings of one file; filled while the messages are handed on.

    Attributes
    ----------
    problems, notes : list of str
        What is wrong, and what could not be checked; one line each.
    schemas, channels : dict
        Records by their numbers.
    metadata : dict
        Metadata records by name.
    counts : Counter
        Messages by channel.
    is_cut : bool
        Whether the end of the file is missing or cannot be found.
    library : str
        Writer of the file.
    """

    file: Path
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    schemas: dict[int, records.Schema] = field(default_factory=dict)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    library: str = ""
    is_cut: bool = False
    _chunks: dict[int, _ChunkSeen] = field(default_factory=dict)
    _fingerprints: dict[tuple[int, ...], int] = field(default_factory=dict)
    # Of the last chunk: its place, and the entries of the index that follows it.
    _chunk_at: int = -1
    _entries: dict[int, NDArray[np.void]] = field(default_factory=dict)
    _index_at: dict[int, dict[int, int]] = field(default_factory=dict)
    _times_ns: list[int] = field(default_factory=list)
    _chunk_indexes: set[int] = field(default_factory=set)
    _seen: Counter[int] = field(default_factory=Counter)
    _summary_at: int = 0

    def messages(self) -> Iterator[TopicMessages]:
        """Visit every record; yield the messages of each undamaged chunk, topic by topic."""
        if not self.file.stat().st_size:
            self._problem("is empty")
            return
        with self.file.open("rb") as stream, mapped(stream) as data:
            yield from self._visit(data)

    def _problem(self, text: str) -> None:
        self.problems.append(f"{self.file.name}: {text}")

    def _note(self, text: str) -> None:
        line = f"{self.file.name}: {text}"
        if line not in self.notes:
            self.notes.append(line)

    def _visit(self, data: mmap) -> Iterator[TopicMessages]:
        if data[: len(MAGIC)] != MAGIC:
            self._problem("does not begin as an MCAP file")
            return
        end = len(MAGIC)
        try:
            for opcode, content, end in walk(data, len(MAGIC)):
                start = content - RECORD_START.size
                try:
                    yield from self._take(data, start, opcode, end)
                except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
                    self._problem(f"the record at byte {start}: {one_line(error)}")
                if opcode == Opcode.FOOTER:
                    break
            else:
                self._problem(f"is cut at byte {end}")
                self.is_cut = True
                return
        except CutError as error:
            self._problem(str(error))
            self.is_cut = True
            return
        if data[end : end + len(MAGIC) + 1] != MAGIC:
            self._problem(f"does not end as an MCAP file at byte {end}")
            self.is_cut = True
        self._compare()

    def _take(self, data: mmap, start: int, opcode: int, end: int) -> Iterator[TopicMessages]:
        self._seen[opcode] += 1
        first = start + RECORD_START.size
        if opcode == Opcode.ATTACHMENT:
            self._attachment(memoryview(data)[first:end], start)
            return
        content = record_content(data, first, end)
        record, length = parse(opcode, content)
        if record is None:
            self._problem(f"the record at byte {start} is of the unknown kind {opcode}")
            return
        chunk = chunk_sizes(data, first, end) if opcode == Opcode.CHUNK else None
        if length != len(content) or (chunk and not has_its_length(data, chunk)):
            self._problem(f"the record at byte {start} does not have its length")
        if isinstance(record, records.Message):
            self._note("has messages outside of chunks")
            yield self._counted(record.channel_id, Messages.of([record.log_time], [record.data]))
        elif isinstance(record, records.Chunk):
            yield from self._chunk(record, start, end)
        elif isinstance(record, records.DataEnd):
            self._data_end(record, memoryview(data)[:start], end)
        elif isinstance(record, records.Footer):
            self._footer(record, memoryview(data)[self._summary_at : end])
        else:
            self._plain(record, start)

    def _attachment(self, content: memoryview, start: int) -> None:
        (checksum,) = CHECKSUM.unpack(content[-CHECKSUM.size :])
        if checksum and crc32(content[: -CHECKSUM.size]) != checksum:
            self._problem(f"the attachment at byte {start} does not have its checksum")

    def _data_end(self, record: records.DataEnd, section: memoryview, end: int) -> None:
        self._summary_at = end
        if not record.data_section_crc:
            self._note("has no checksum over its data section, only what its chunks have")
        elif crc32(section) != record.data_section_crc:
            self._problem("the data section does not have its checksum")

    def _plain(self, record: records.McapRecord | None, start: int) -> None:
        if isinstance(record, records.Header):
            self.library = record.library
        elif isinstance(record, records.Schema):
            self._same("schema", record.id, self.schemas.setdefault(record.id, record), record)
        elif isinstance(record, records.Channel):
            self._same("channel", record.id, self.channels.setdefault(record.id, record), record)
        elif isinstance(record, records.MessageIndex):
            self._message_index(record, start)
        elif isinstance(record, records.Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, records.ChunkIndex):
            self._chunk_index(record)
        elif isinstance(record, records.Statistics):
            self._statistics(record)
        elif isinstance(record, records.SummaryOffset) and record.group_start > start:
            self._problem(f"the summary offset at byte {start} points behind itself")

    def _same(self, kind: str, number: int, first: object, second: object) -> None:
        if first != second:
            self._problem(f"{kind} {number} is stored in two versions")

    def _counted(self, channel: int, messages: Messages) -> TopicMessages:
        if channel not in self.channels:
            raise ValueError(f"messages of the unknown channel {channel}")
        self.counts[channel] += len(messages.log_times_ns)
        self._times_ns += [int(messages.log_times_ns.min()), int(messages.log_times_ns.max())]
        return TopicMessages(self.channels[channel].topic, messages)

    def _chunk(self, chunk: records.Chunk, start: int, end: int) -> Iterator[TopicMessages]:
        if not chunk.uncompressed_crc:
            self._note("has chunks without a checksum")
        content = chunk_content(chunk)
        offsets = self._offsets(content)
        parts, entries = {}, {}
        if len(offsets):
            heads = heads_at(content, offsets)
            for channel in np.unique(heads["channel"]).tolist():
                chosen = heads["channel"] == channel
                parts[channel] = (heads[chosen], offsets[chosen])
                entries[channel] = np.empty(np.count_nonzero(chosen), INDEX_ENTRY)
                entries[channel]["log_time"] = heads["log_time"][chosen]
                entries[channel]["offset"] = offsets[chosen]
        times_ns = (chunk.message_start_time, chunk.message_end_time)
        every = heads["log_time"] if len(offsets) else np.zeros(1, np.uint64)
        if times_ns != (int(every.min()), int(every.max())):
            self._problem(f"the chunk at byte {start} does not have the times of its messages")
        sizes = (len(chunk.data), len(content))
        self._chunks[start] = _ChunkSeen(end - start, chunk.compression, sizes, times_ns)
        self._chunk_at, self._entries = start, entries
        first = self._fingerprints.setdefault(fingerprint(chunk), start)
        if first != start and entries:
            self._problem(f"the chunk at byte {start} is that of byte {first} again")
        for channel, part in parts.items():
            yield self._counted(channel, gathered(content, *part))

    def _offsets(self, content: NDArray[np.uint8]) -> NDArray[np.intp]:
        """Walk a chunk; return the positions of its messages."""
        data = content.tobytes()
        found = []
        for opcode, start, end in chunk_records(data):
            position = start - RECORD_START.size
            if opcode == Opcode.MESSAGE:
                found.append(position)
                continue
            if opcode not in {Opcode.SCHEMA, Opcode.CHANNEL}:
                raise ValueError(f"a chunk holds a record of the unknown kind {opcode}")
            self._plain(parse(opcode, data[start:end])[0], position)
        return np.array(found, np.intp)

    def _message_index(self, index: records.MessageIndex, start: int) -> None:
        if not self._chunks:
            raise ValueError("an index without a chunk before it")
        self._index_at.setdefault(self._chunk_at, {})[index.channel_id] = start
        stated = np.array(index.records, INDEX_ENTRY)
        found = self._entries.get(index.channel_id, np.empty(0, INDEX_ENTRY))
        if not np.array_equal(np.sort(stated), np.sort(found)):
            self._problem(f"the index at byte {start} does not point at the messages of its chunk")

    def _chunk_index(self, index: records.ChunkIndex) -> None:
        chunk = self._chunks.get(index.chunk_start_offset)
        self._chunk_indexes.add(index.chunk_start_offset)
        found = chunk and (chunk.length, chunk.compression, chunk.sizes, chunk.times_ns)
        stated = (
            index.chunk_length,
            index.compression,
            (index.compressed_size, index.uncompressed_size),
            (index.message_start_time, index.message_end_time),
        )
        at = self._index_at.get(index.chunk_start_offset, {})
        if found != stated or index.message_index_offsets != at:
            self._problem(
                f"the index of the chunk at byte {index.chunk_start_offset} does not fit it"
            )

    def _statistics(self, stated: records.Statistics) -> None:
        times_ns = self._times_ns or [0]
        found = {
            "messages": (stated.message_count, self.counts.total()),
            "messages by channel": (
                {key: count for key, count in stated.channel_message_counts.items() if count},
                dict(self.counts),
            ),
            "first time": (stated.message_start_time, min(times_ns)),
            "last time": (stated.message_end_time, max(times_ns)),
            "chunks": (stated.chunk_count, self._seen[Opcode.CHUNK]),
            "channels": (stated.channel_count, len(self.channels)),
            "schemas": (stated.schema_count, len(self.schemas)),
            "metadata": (stated.metadata_count, self._seen[Opcode.METADATA]),
            "attachments": (stated.attachment_count, self._seen[Opcode.ATTACHMENT]),
        }
        for name, (said, seen) in found.items():
            if said != seen:
                self._problem(f"{name}: the statistics say {said}, there are {seen}")

    def _footer(self, footer: records.Footer, summary: memoryview) -> None:
        if footer.summary_start not in {0, self._summary_at}:
            self._problem("the footer does not point at the summary")
        if not footer.summary_crc:
            self._note("has no checksum over its summary")
        elif crc32(summary[: -CHECKSUM.size]) != footer.summary_crc:
            self._problem("the summary does not have its checksum")

    def _compare(self) -> None:
        if self._seen[Opcode.DATA_END] != 1:
            self._problem("has no end of its data section")
        if self._seen[Opcode.CHUNK_INDEX] and set(self._chunks) != self._chunk_indexes:
            self._problem("the numbers of chunks and of their indexes differ")
        if not self._seen[Opcode.STATISTICS]:
            self._note("has no statistics: a missing chunk can go unnoticed")
