"""MCAP record layout: magic, record starts, fixed parts, and the parsing of single records.

A file is a magic, records, and the magic again. A record is an opcode, a length, and as many bytes.
Messages stand in compressed chunks; behind the data a summary says where the chunks are.
"""

from __future__ import annotations

import struct
from contextlib import contextmanager, suppress
from io import SEEK_END, BytesIO
from itertools import islice
from mmap import ACCESS_READ, mmap
from typing import TYPE_CHECKING, BinaryIO, NamedTuple
from zlib import crc32

import numpy as np
import zstandard
from lz4.frame import LZ4FrameDecompressor, get_frame_info
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from flexarm_core.bounds import BoundError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

MAGIC = b"\x89MCAP0\r\n"
RECORD_START = struct.Struct("<BQ")
"""Opcode, and the length of what follows."""
CHECKSUM = struct.Struct("<I")
"""CRC-32 at the end of an attachment and of the footer; 0: none."""
_MESSAGE_START = struct.Struct("<HIQQ")
MESSAGE_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""What stands in front of a message's bytes, for many messages at once."""
MESSAGE_FIXED = _MESSAGE_START.size
"""Bytes of a message record that are none of the message itself."""
INDEX_START = struct.Struct("<HI")
"""Channel and length of the entries of a message index."""
INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
"""Entry of a message index; the offset counts from the start of the chunk's content."""
CHUNK_BYTES = 128 << 20
"""Largest chunk, unpacked: recorders write chunks of a few megabytes at most."""
_MOST_RECORDS = CHUNK_BYTES >> 8
# Unpacked size and length of the compression's name, behind the times and before the checksum.
_CHUNK_START = struct.Struct("<16xQ4xI")
_LENGTH = struct.Struct("<Q")
_PART_BYTES = 1 << 20
# An index of a chunk has some hundred bytes.
_SUMMARY_BYTES, _SUMMARY_PART = 16 << 20, 64
# The whole footer with the magic behind it: summary start, offset section and checksum.
_FILE_END = struct.Struct("<BQQQI8s")

_PARSERS: dict[int, Callable[[ReadDataStream], records.McapRecord]] = {
    Opcode.HEADER: records.Header.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.CHUNK: records.Chunk.read,
    Opcode.MESSAGE_INDEX: records.MessageIndex.read,
    Opcode.CHUNK_INDEX: records.ChunkIndex.read,
    Opcode.ATTACHMENT_INDEX: records.AttachmentIndex.read,
    Opcode.STATISTICS: records.Statistics.read,
    Opcode.METADATA: records.Metadata.read,
    Opcode.METADATA_INDEX: records.MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: records.SummaryOffset.read,
    Opcode.DATA_END: records.DataEnd.read,
    Opcode.FOOTER: records.Footer.read,
}


class CutError(ValueError):
    """A record goes beyond the end of its file or chunk."""


class TooManyError(ValueError):
    """A chunk holds more records than any recorder writes into one."""


def walk(data: bytes | mmap, position: int = 0) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start of the content and end of each record, from a position on.

    Raises
    ------
    CutError
        When a record goes beyond the end of the data.
    """
    while position < len(data):
        start = position + RECORD_START.size
        if start > len(data):
            raise CutError(f"is cut at byte {position}")
        opcode, length = RECORD_START.unpack_from(data, position)
        if start + length > len(data):
            raise CutError(f"the record at byte {position} is cut")
        position = start + length
        yield opcode, start, position


def chunk_records(content: bytes) -> list[tuple[int, int, int]]:
    """Return the places of the records in a chunk's content, as `walk` yields them.

    Raises
    ------
    CutError
        When a record is cut.
    TooManyError
        When there are more than any recorder writes into a chunk.
    """
    found = list(islice(walk(content), _MOST_RECORDS + 1))
    if len(found) > _MOST_RECORDS:
        raise TooManyError(f"a chunk holds more than {_MOST_RECORDS} records")
    return found


def whole_records(content: bytes) -> list[tuple[int, int, int]]:
    """Return the places of the records up to the first one that is cut, as `walk` yields them."""
    found = []
    with suppress(CutError):
        for place in islice(walk(content), _MOST_RECORDS):
            found.append(place)  # noqa: PERF402 - what is cut ends the walk with an error
    return found


def record_content(data: bytes | mmap, start: int, end: int) -> bytes:
    """Return the content of a record; ValueError when it is larger than any but an attachment."""
    _require_record_size(end - start)
    return data[start:end]


def record_at(stream: BinaryIO, place: int) -> bytes:
    """Return the content of the record that begins at a place; ValueError as `record_content`."""
    stream.seek(place)
    _, length = RECORD_START.unpack(stream.read(RECORD_START.size))
    _require_record_size(length)
    return stream.read(length)


def _require_record_size(size: int) -> None:
    if size > CHUNK_BYTES:
        raise ValueError(f"a record of {size >> 20} MB, allowed are {CHUNK_BYTES >> 20}")


class _Content(BytesIO):
    """Content of a record, which ends there whatever length one of its parts states."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return the next bytes; a length of 2^63 or more is not an error, as for BytesIO."""
        return super().read(-1 if size is None else min(size, self.getbuffer().nbytes))


def parse(opcode: int, content: bytes) -> tuple[records.McapRecord | None, int]:
    """Return a record and the length that was used of its content.

    Attachments and unknown kinds give no record.
    """
    if opcode == Opcode.MESSAGE:
        channel, sequence, log_time_ns, publish_time_ns = _MESSAGE_START.unpack_from(content)
        raw = content[MESSAGE_FIXED:]
        return records.Message(channel, log_time_ns, raw, publish_time_ns, sequence), len(content)
    parser = _PARSERS.get(opcode)
    if parser is None:
        return None, 0
    stream = ReadDataStream(_Content(content))
    return parser(stream), stream.count


@contextmanager
def mapped(stream: BinaryIO) -> Iterator[mmap]:
    """Map a file of one byte or more into memory; the last view of it may outlive the block."""
    data = mmap(stream.fileno(), 0, access=ACCESS_READ)
    try:
        yield data
    finally:
        # A view that waits for the collector of garbage is not an error.
        with suppress(BufferError):
            data.close()


def summary_of(stream: BinaryIO) -> list[records.McapRecord]:
    """Return the records of the summary; nothing when the file has none.

    Raises
    ------
    ValueError
        When the end of the file is damaged, or the summary does not have its checksum.
    BoundError
        When most of a large file would be its summary.
    """
    size = stream.seek(0, SEEK_END)
    stream.seek(max(0, size - _FILE_END.size))
    end = stream.read()
    if len(end) < _FILE_END.size:
        raise CutError("the file is cut")
    opcode, _, start, _, checksum, magic = _FILE_END.unpack(end)
    if opcode != Opcode.FOOTER or magic != MAGIC or start > size:
        raise CutError("the file does not end as an MCAP file")
    if not start:
        return []
    if size - start > _SUMMARY_BYTES + size // _SUMMARY_PART:
        raise BoundError(f"a summary of {size - start >> 20} of {size >> 20} MB is not a summary")
    stream.seek(start)
    raw = stream.read()[: -len(MAGIC)]
    # The checksum covers everything from the summary on, up to itself.
    if checksum and crc32(raw[: -CHECKSUM.size]) != checksum:
        raise ValueError("the summary does not have its checksum")
    parsed = (parse(opcode, raw[start:end])[0] for opcode, start, end in walk(raw))
    return [record for record in parsed if record is not None]


def chunk_at(stream: BinaryIO, place: int) -> records.Chunk:
    """Return the chunk whose record begins at a place; ValueError as in `record_content`."""
    chunk: records.Chunk = records.Chunk.read(ReadDataStream(_Content(record_at(stream, place))))
    return chunk


def chunk_content(chunk: records.Chunk) -> NDArray[np.uint8]:
    """Return the checked and uncompressed bytes of a chunk.

    Raises
    ------
    ValueError
        When it does not have its checksum or its size, or is larger than any chunk may be.
    """
    size = chunk.uncompressed_size
    if size > CHUNK_BYTES:
        raise ValueError(f"a chunk of {size >> 20} MB, allowed are {CHUNK_BYTES >> 20}")
    content = unpacked(chunk.data, chunk.compression, size)
    if len(content) != size:
        raise ValueError(f"a chunk of {size} bytes has {len(content)}")
    if chunk.uncompressed_crc and crc32(content) != chunk.uncompressed_crc:
        raise ValueError("a chunk does not have its checksum")
    return np.frombuffer(content, np.uint8)


def unpacked(packed: bytes, compression: str, size: int) -> bytes:
    """Return what a chunk holds; of one that holds more than it states, one byte more."""
    if not compression:
        return packed
    if compression == "zstd":
        # The size in the frame's own head is what would be asked of the memory.
        stated = zstandard.frame_content_size(packed)
        if stated not in {-1, size}:
            raise ValueError(f"a chunk of {size} bytes says it has {stated}")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    if compression == "lz4":
        return bytes(LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    raise ValueError(f"a chunk of the unknown compression {compression}")


def unpacked_beginning(packed: bytes, compression: str, size: int) -> bytes:
    """Return what the first bytes of a chunk give: whole blocks of its compression."""
    if compression == "zstd":
        stated = zstandard.frame_content_size(packed)
        if stated not in {-1, size}:
            raise ValueError(f"a chunk of {size} bytes says it has {stated}")
        return zstandard.ZstdDecompressor().stream_reader(packed).read(size)
    return unpacked(packed, compression, size)[:size]


def fingerprint(chunk: records.Chunk) -> tuple[int, ...]:
    """Return what distinguishes a chunk: times and sizes of its messages, and its bytes."""
    times_ns = (chunk.message_start_time, chunk.message_end_time)
    return (*times_ns, chunk.uncompressed_size, len(chunk.data), crc32(chunk.data))


class ChunkSizes(NamedTuple):
    """Place of a chunk, its sizes as it states them, and the place of its packed bytes."""

    record_start: int
    unpacked: int
    compression: str
    packed_start: int
    packed_end: int


def chunk_sizes(data: mmap, start: int, end: int) -> ChunkSizes | None:
    """Return the sizes of the chunk whose content is from start to end; None when it is cut."""
    if start + _CHUNK_START.size > end:
        return None
    size, length = _CHUNK_START.unpack_from(data, start)
    name_end = start + _CHUNK_START.size + length
    packed_start = name_end + _LENGTH.size
    if packed_start > end:
        return None
    (packed,) = _LENGTH.unpack_from(data, name_end)
    name = data[start + _CHUNK_START.size : name_end].decode("utf-8", "replace")
    return ChunkSizes(
        start - RECORD_START.size, size, name, packed_start, min(packed_start + packed, end)
    )


def has_its_length(data: mmap, chunk: ChunkSizes) -> bool:
    """Return whether a chunk fills its record: both state the length of its packed bytes."""
    _, length = RECORD_START.unpack_from(data, chunk.record_start)
    (packed,) = _LENGTH.unpack_from(data, chunk.packed_start - _LENGTH.size)
    head = chunk.packed_start - chunk.record_start - RECORD_START.size
    return bool(length == head + packed)


def unpacked_bytes(packed: bytes, compression: str, most: int) -> int:
    """Return how many bytes a decompressor would make, up to one more than `most`.

    It counts what the head of a frame asks of the memory, and every frame. Damage ends the count.
    """
    total = 0
    with suppress(Exception):
        if compression == "zstd":
            total = max(0, zstandard.frame_content_size(packed))
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            counted = 0
            while total <= most and (part := reader.read(_PART_BYTES)):
                counted += len(part)
                total = max(total, counted)
        elif compression == "lz4":
            total = int(get_frame_info(packed)["content_size"])
            if total <= most:
                total = len(LZ4FrameDecompressor().decompress(packed, max_length=most + 1))
    return min(total, most + 1)
