"""Messages of one topic out of MCAP chunks, many at a time.

Reading message by message costs several microseconds each in Python. Here the index behind every
chunk tells where its messages are, and numpy gathers them. Every checksum that the file carries is
verified: of each chunk, and of the summary that says where the chunks are. An index carries none,
so what it points at is compared with what it says.
"""

from __future__ import annotations

import io
import struct
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, BinaryIO
from zlib import crc32

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream
from numpy.lib.stride_tricks import sliding_window_view

from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from mcap.records import ChunkIndex
    from numpy.typing import NDArray

    from flexarm_bags.columns import ByteRows

_MESSAGE_HEADER = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
# Opcode and length stand in front of what the length counts.
_RECORD_START = struct.Struct("<BQ")
_INDEX_STORED = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
_INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8"), ("channel", "<u2")])
# An index begins with its channel and the length of its entries.
_INDEX_START = 6
# Footer without opcode and length: summary start, offset section, checksum; then the magic.
_FILE_END = struct.Struct("<QQI8s")
_CHECKSUM_AND_MAGIC = 12
_FIXED_PART = _MESSAGE_HEADER.itemsize - _RECORD_START.size


@dataclass(frozen=True)
class Messages:
    """Serialised messages of one topic.

    Attributes
    ----------
    log_times_ns : (messages,)
        When each was sent.
    groups
        Message numbers and bytes by size, as :func:`flexarm_bags.columns.decode` takes them.
    """

    log_times_ns: NDArray[np.int64]
    groups: list[tuple[NDArray[np.intp], ByteRows]]

    @classmethod
    def of(cls, log_times_ns: Sequence[int], raws: Sequence[bytes]) -> Messages:
        """Return messages that were read one by one."""
        sizes = np.array([len(raw) for raw in raws], dtype=np.int64)
        groups = []
        for size in np.unique(sizes).tolist():
            numbers = np.flatnonzero(sizes == size)
            joined = b"".join(raws[number] for number in numbers.tolist())
            groups.append((numbers, np.frombuffer(joined, np.uint8).reshape(-1, size)))
        return cls(np.array(log_times_ns, dtype=np.int64), groups)


class _Collector:
    """Gathers one topic's messages from chunks, numbers them and sorts them by size."""

    def __init__(self) -> None:
        self._log_times_ns: list[NDArray[np.int64]] = [np.empty(0, np.int64)]
        self._rows: dict[int, list[ByteRows]] = defaultdict(list)
        self._numbers: dict[int, list[NDArray[np.intp]]] = defaultdict(list)
        self.total = 0

    def add(
        self, data: NDArray[np.uint8], heads: NDArray[np.void], offsets: NDArray[np.intp]
    ) -> None:
        sizes = (heads["length"] - _FIXED_PART).astype(np.intp)
        starts = offsets + _MESSAGE_HEADER.itemsize
        if np.all(sizes == sizes[0]):
            self._take(data, starts, np.arange(len(heads)), int(sizes[0]))
        else:
            for size in np.unique(sizes).tolist():
                numbers = np.flatnonzero(sizes == size)
                self._take(data, starts[numbers], numbers, size)
        self._log_times_ns.append(heads["log_time"].astype(np.int64))
        self.total += len(heads)

    def _take(
        self,
        data: NDArray[np.uint8],
        starts: NDArray[np.intp],
        numbers: NDArray[np.intp],
        size: int,
    ) -> None:
        self._rows[size].append(_rows(data, starts, size))
        self._numbers[size].append(numbers + self.total)

    def messages(self) -> Messages:
        groups = [
            (np.concatenate(self._numbers[size]), np.concatenate(rows))
            for size, rows in self._rows.items()
        ]
        return Messages(np.concatenate(self._log_times_ns), groups)


class NotIndexedError(FlexarmError):
    """A file is not fully chunked and indexed: only a message by message reader can take it."""


def read_topic(streams: Iterable[BinaryIO], topic: str) -> Messages | None:
    """Read all messages of a topic, chunk by chunk.

    Parameters
    ----------
    streams
        Open MCAP files, in the order in which a split bag was written.
    topic
        Name of the topic.

    Returns
    -------
    Messages or None
        In the order of writing; None when a file is not fully chunked and indexed, so that a
        message by message reader has to be used.

    Raises
    ------
    ValueError
        If a chunk or the summary does not have its checksum, or records do not fill their chunk.
    """
    collector = _Collector()
    try:
        for piece in _pieces(streams, topic):
            collector.add(*piece)
    except NotIndexedError:
        return None
    return collector.messages()


def topic_pieces(streams: Iterable[BinaryIO], topic: str) -> Iterator[Messages]:
    """Read the messages of a topic and hand them on chunk by chunk, so that memory stays small.

    Parameters
    ----------
    streams
        Open MCAP files, in the order in which a split bag was written.
    topic
        Name of the topic.

    Yields
    ------
    Messages
        Those of one chunk, numbered from 0.

    Raises
    ------
    NotIndexedError
        If a file is not fully chunked and indexed; known at its end.
    ValueError
        If a chunk or the summary does not have its checksum, or records do not fill their chunk.
    """
    for piece in _pieces(streams, topic):
        yield gathered(*piece)


def gathered(
    data: NDArray[np.uint8], heads: NDArray[np.void], offsets: NDArray[np.intp]
) -> Messages:
    """Return messages out of a chunk's bytes, numbered from 0.

    Parameters
    ----------
    data
        From :func:`chunk_content`.
    heads, offsets
        Fixed parts and places of the messages' records.
    """
    collector = _Collector()
    collector.add(data, heads, offsets)
    return collector.messages()


def heads_at(data: NDArray[np.uint8], offsets: NDArray[np.intp]) -> NDArray[np.void]:
    """Return the fixed parts of the messages whose records begin at the offsets.

    Parameters
    ----------
    data
        From :func:`chunk_content`.
    offsets
        At least one.

    Raises
    ------
    ValueError
        If a message does not fit into the data.
    """
    if int(offsets.max()) + _MESSAGE_HEADER.itemsize <= len(data):
        rows = _rows(data, offsets, _MESSAGE_HEADER.itemsize)
        heads: NDArray[np.void] = rows.view(_MESSAGE_HEADER)[:, 0]
        ends = offsets.astype(np.uint64) + heads["length"] + _RECORD_START.size
        if int(heads["length"].min()) >= _FIXED_PART and int(ends.max()) <= len(data):
            return heads
    raise ValueError("a message does not fit into its chunk")


def _rows(data: NDArray[np.uint8], starts: NDArray[np.intp], width: int) -> ByteRows:
    """Return the bytes that follow each start; all of them lie within the data."""
    steps = np.diff(starts)
    if len(steps) and steps[0] > 0 and np.all(steps == steps[0]):
        # At even distances, as samples and their commands alternate: nothing has to be gathered.
        return np.ndarray((len(starts), width), np.uint8, data, int(starts[0]), (int(steps[0]), 1))
    rows: ByteRows = sliding_window_view(data, width)[starts]
    return rows


def _pieces(
    streams: Iterable[BinaryIO], topic: str
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.void], NDArray[np.intp]]]:
    """Yield bytes, fixed parts and offsets of each chunk's messages."""
    total = expected = 0
    for stream in streams:
        reader = make_reader(stream)
        _check_summary(stream)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise NotIndexedError("the file has no summary")
        wanted = [key for key, entry in summary.channels.items() if entry.topic == topic]
        counts = summary.statistics.channel_message_counts
        expected += sum(counts.get(key, 0) for key in wanted)
        for index in sorted(summary.chunk_indexes, key=lambda entry: entry.chunk_start_offset):
            entries = _index_entries(stream, index, wanted)
            if len(entries):
                stream.seek(index.chunk_start_offset + _RECORD_START.size)
                data = chunk_content(Chunk.read(ReadDataStream(stream)))
                heads = _heads(data, entries)
                total += len(heads)
                yield data, heads, entries["offset"].astype(np.intp)
        if total != expected:
            raise NotIndexedError("messages stand outside of the indexed chunks")


def _check_summary(stream: BinaryIO) -> None:
    stream.seek(-_FILE_END.size, io.SEEK_END)
    summary_start, _, checksum, _ = _FILE_END.unpack(stream.read(_FILE_END.size))
    if not checksum:
        return
    # The checksum covers everything from the summary on, up to itself.
    length = stream.tell() - summary_start - _CHECKSUM_AND_MAGIC
    stream.seek(summary_start)
    if crc32(stream.read(max(length, 0))) != checksum:
        raise ValueError("the summary does not have its checksum")


def _index_entries(
    stream: BinaryIO, index: ChunkIndex, channels: Sequence[int]
) -> NDArray[np.void]:
    """Return where a chunk has messages of the channels, in the order of writing."""
    found = [np.empty(0, _INDEX_ENTRY)]
    for channel in channels:
        if channel not in index.message_index_offsets:
            continue
        stream.seek(index.message_index_offsets[channel])
        _, length = _RECORD_START.unpack(stream.read(_RECORD_START.size))
        entries = np.frombuffer(stream.read(length)[_INDEX_START:], _INDEX_STORED)
        numbered = np.empty(len(entries), _INDEX_ENTRY)
        numbered["log_time"], numbered["offset"] = entries["log_time"], entries["offset"]
        numbered["channel"] = channel
        found.append(numbered)
    joined = np.concatenate(found)
    if np.all(joined["offset"][1:] > joined["offset"][:-1]):
        return joined
    return joined[np.argsort(joined["offset"], kind="stable")]


def chunk_content(chunk: Chunk) -> NDArray[np.uint8]:
    """Return the checked and uncompressed bytes of a chunk.

    Parameters
    ----------
    chunk
        As it stands in the file.

    Raises
    ------
    ValueError
        If it does not have its checksum or its size.
    """
    if chunk.compression == "zstd":
        # The size in the frame's own head is what would be asked of the memory.
        stated = zstandard.frame_content_size(chunk.data)
        if stated not in {-1, chunk.uncompressed_size}:
            raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes says it has {stated}")
        content = zstandard.ZstdDecompressor().decompress(
            chunk.data, max_output_size=chunk.uncompressed_size
        )
        if chunk.uncompressed_crc and crc32(content) != chunk.uncompressed_crc:
            raise ValueError("a chunk does not have its checksum")
    else:
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        content = stream.read(length)
    if len(content) != chunk.uncompressed_size:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes has {len(content)}")
    return np.frombuffer(content, np.uint8)


def _heads(data: NDArray[np.uint8], entries: NDArray[np.void]) -> NDArray[np.void]:
    """Return the fixed parts of the messages that the entries point at."""
    offsets = entries["offset"]
    if int(offsets.max()) < len(data):
        heads = heads_at(data, offsets.astype(np.intp))
        if (
            np.all(heads["opcode"] == Opcode.MESSAGE)
            and np.all(heads["channel"] == entries["channel"])
            and np.all(heads["log_time"] == entries["log_time"])
        ):
            return heads
    raise ValueError("an index does not point at its messages")
