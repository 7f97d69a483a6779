"""MCAP record layout: magic, record starts, fixed parts, and the parsing of single records.

A file is a magic, records, and the magic again. A record is an opcode, a length, and as many bytes.
Messages stand in compressed chunks; behind the data a summary says where the chunks are.
"""

from __future__ import annotations

import struct
from io import SEEK_END, BytesIO
from typing import TYPE_CHECKING, BinaryIO
from zlib import crc32

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.stream_reader import get_chunk_data_stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from mmap import mmap

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
    stream = ReadDataStream(BytesIO(content))
    return parser(stream), stream.count


def summary_of(stream: BinaryIO) -> list[records.McapRecord]:
    """Return the records of the summary; nothing when the file has none.

    Raises
    ------
    ValueError
        When the end of the file is damaged, or the summary does not have its checksum.
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
    stream.seek(start)
    raw = stream.read()[: -len(MAGIC)]
    # The checksum covers everything from the summary on, up to itself.
    if checksum and crc32(raw[: -CHECKSUM.size]) != checksum:
        raise ValueError("the summary does not have its checksum")
    parsed = (parse(opcode, raw[start:end])[0] for opcode, start, end in walk(raw))
    return [record for record in parsed if record is not None]


def chunk_content(chunk: records.Chunk) -> NDArray[np.uint8]:
    """Return the checked and uncompressed bytes of a chunk.

    Raises
    ------
    ValueError
        When it does not have its checksum or its size.
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
