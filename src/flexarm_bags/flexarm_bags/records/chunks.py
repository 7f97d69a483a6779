"""Topic messages from MCAP chunks, many at a time.

Reading message by message costs several microseconds each in Python. Here the index behind every
chunk gives the positions of its messages, and numpy gathers them. Every checksum in the file is
verified: of each chunk, and of the summary that locates the chunks. An index has no checksum, so
it is compared with the messages themselves.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Statistics
from numpy.lib.stride_tricks import sliding_window_view

from flexarm_bags.records.layout import (
    INDEX_ENTRY,
    INDEX_START,
    MESSAGE_FIXED,
    MESSAGE_HEAD,
    RECORD_START,
    chunk_at,
    chunk_content,
    record_at,
    summary_of,
)
from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from mcap.records import McapRecord
    from numpy.typing import NDArray

    from flexarm_bags.records.columns import ByteRows

_POINTER = np.dtype([*INDEX_ENTRY.descr, ("channel", "<u2")])


@dataclass(frozen=True)
class Messages:
    """Serialised messages of one topic.

    Attributes
    ----------
    log_times_ns : ndarray of int, (messages,)
        Instants of sending.
    groups : list
        Message numbers and bytes by size, as `columns.decode` takes them.
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

    def raws(self) -> list[bytes]:
        """Return the messages one by one, in the order of their numbers."""
        found = [b""] * len(self.log_times_ns)
        for numbers, rows in self.groups:
            for number, row in zip(numbers.tolist(), rows, strict=True):
                found[number] = row.tobytes()
        return found

    def in_order(self) -> Messages:
        """Return the messages by their instants: a file may have its chunks in any order.

        They stay where the instants of a clock that was set back would mingle with those before.
        """
        times_ns = self.log_times_ns
        steps = np.diff(times_ns)
        order = np.argsort(times_ns, kind="stable")
        ahead = steps[steps > 0]
        if np.all(steps >= 0) or not len(ahead):
            return self
        if 2 * np.median(np.diff(times_ns[order])) <= np.median(ahead):
            return self
        numbers_now = np.empty_like(order)
        numbers_now[order] = np.arange(len(order))
        groups = []
        for numbers, rows in self.groups:
            now = numbers_now[numbers]
            by_number = np.argsort(now)
            groups.append((now[by_number], rows[by_number]))
        return Messages(times_ns[order], groups)

    def first(self) -> Messages:
        """Return the first message alone."""
        (raw,) = (rows[0].tobytes() for numbers, rows in self.groups if numbers[0] == 0)
        return Messages.of([int(self.log_times_ns[0])], [raw])

    @classmethod
    def joined(cls, pieces: Iterable[Messages]) -> Messages:
        """Return the messages of all pieces, with consecutive numbers."""
        times_ns: list[NDArray[np.int64]] = [np.empty(0, np.int64)]
        by_size: dict[int, list[tuple[NDArray[np.intp], ByteRows]]] = defaultdict(list)
        total = 0
        for piece in pieces:
            for numbers, rows in piece.groups:
                by_size[rows.shape[1]].append((numbers + total, rows))
            times_ns.append(piece.log_times_ns)
            total += len(piece.log_times_ns)
        groups = [
            (
                np.concatenate([numbers for numbers, _ in found]),
                np.concatenate([r for _, r in found]),
            )
            for found in by_size.values()
        ]
        return cls(np.concatenate(times_ns), groups)


class NotIndexedError(FlexarmError):
    """A file is not fully chunked and indexed: it can only be read message by message."""


@dataclass(frozen=True)
class IndexedFile:
    """An open MCAP file with its summary, which is read on first use."""

    stream: BinaryIO

    @cached_property
    def _summary(self) -> list[McapRecord]:
        return summary_of(self.stream)

    @cached_property
    def statistics(self) -> Statistics:
        """Statistics of the file; NotIndexedError when it has none."""
        for record in self._summary:
            if isinstance(record, Statistics):
                return record
        raise NotIndexedError("the file has no summary")

    @cached_property
    def topics(self) -> dict[int, str]:
        """Topic of each channel."""
        return {each.id: each.topic for each in self._summary if isinstance(each, Channel)}

    @cached_property
    def chunks(self) -> list[ChunkIndex]:
        """Indexes of the chunks, in the order of the file."""
        found = (record for record in self._summary if isinstance(record, ChunkIndex))
        return sorted(found, key=lambda index: index.chunk_start_offset)


def read_topic(files: Iterable[IndexedFile], topic: str) -> Messages | None:
    """Read all messages of a topic, in the order of writing.

    The result is None when a file is not fully chunked and indexed, and has to be read message by
    message. Parameters and other errors are those of `topic_pieces`.
    """
    try:
        return Messages.joined(topic_pieces(files, topic))
    except NotIndexedError:
        return None


def topic_pieces(files: Iterable[IndexedFile], topic: str) -> Iterator[Messages]:
    """Yield the messages of a topic chunk by chunk, each numbered from 0, to keep memory small.

    Parameters
    ----------
    files : iterable of IndexedFile
        Files of the bag, in the order in which they were written.
    topic : str
        Name of the topic.

    Raises
    ------
    NotIndexedError
        When a file is not fully chunked and indexed; known at its end.
    ValueError
        When a chunk or the summary does not have its checksum, or records do not fill their chunk.
    """
    total = expected = 0
    for file in files:
        counts = file.statistics.channel_message_counts
        wanted = [key for key, name in file.topics.items() if name == topic]
        expected += sum(counts.get(key, 0) for key in wanted)
        for index in file.chunks:
            entries = _index_entries(file.stream, index, wanted)
            if len(entries):
                content = chunk_content(chunk_at(file.stream, index.chunk_start_offset))
                heads = _heads(content, entries)
                total += len(heads)
                yield gathered(content, heads, entries["offset"].astype(np.intp))
        if total != expected:
            raise NotIndexedError("messages stand outside of the indexed chunks")


def gathered(
    content: NDArray[np.uint8], heads: NDArray[np.void], offsets: NDArray[np.intp]
) -> Messages:
    """Return messages from a chunk, numbered from 0.

    Parameters
    ----------
    content : ndarray of uint8, (bytes,)
        Content of the chunk, from `layout.chunk_content`.
    heads, offsets : ndarray, (messages,)
        Fixed parts and positions of the messages' records; at least one.
    """
    sizes = (heads["length"] - MESSAGE_FIXED).astype(np.intp)
    starts = offsets + MESSAGE_HEAD.itemsize
    different = sizes[:1] if np.all(sizes == sizes[0]) else np.unique(sizes)
    groups = []
    for size in different.tolist():
        numbers = np.flatnonzero(sizes == size)
        groups.append((numbers, _rows(content, starts[numbers], size)))
    return Messages(heads["log_time"].astype(np.int64), groups)


def heads_at(data: NDArray[np.uint8], offsets: NDArray[np.intp]) -> NDArray[np.void]:
    """Return the fixed parts of the messages whose records begin at one or more offsets.

    Raises
    ------
    ValueError
        If a message does not fit into the data.
    """
    if int(offsets.max()) + MESSAGE_HEAD.itemsize <= len(data):
        rows = _rows(data, offsets, MESSAGE_HEAD.itemsize)
        heads: NDArray[np.void] = rows.view(MESSAGE_HEAD)[:, 0]
        ends = offsets.astype(np.uint64) + heads["length"] + RECORD_START.size
        if int(heads["length"].min()) >= MESSAGE_FIXED and int(ends.max()) <= len(data):
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


def _index_entries(
    stream: BinaryIO, index: ChunkIndex, channels: Sequence[int]
) -> NDArray[np.void]:
    """Return the index entries of a chunk for the channels, in the order of writing."""
    found = [np.empty(0, _POINTER)]
    for channel in channels:
        if channel not in index.message_index_offsets:
            continue
        content = record_at(stream, index.message_index_offsets[channel])
        entries = np.frombuffer(content[INDEX_START.size :], INDEX_ENTRY)
        numbered = np.empty(len(entries), _POINTER)
        numbered["log_time"], numbered["offset"] = entries["log_time"], entries["offset"]
        numbered["channel"] = channel
        found.append(numbered)
    joined = np.concatenate(found)
    if np.all(joined["offset"][1:] > joined["offset"][:-1]):
        return joined
    return joined[np.argsort(joined["offset"], kind="stable")]


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
