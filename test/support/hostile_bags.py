"""Bags that say one thing and hold another: bombs, wrong sizes, wrong definitions."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

import lz4.frame
import yaml
import zstandard

from flexarm_bags.metadata import RecordedTopic
from flexarm_bags.schema import MessageDefinition, describe
from flexarm_bags.writer import BagWriter
from support.bag_samples import typestore

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from support.bag_samples import Sent

MAGIC = b"\x89MCAP0\r\n"
ARM_STATE = "flexarm_msgs/msg/ArmState"
STATE = "/flexarm/state"
MB = 1 << 20


class Packed(NamedTuple):
    """Content of a chunk, and the size that the chunk says it has."""

    compression: str
    data: bytes
    stated: int


def lz4_zeros(megabytes: int) -> bytes:
    """Return an lz4 frame of zeros that states no size."""
    compressor = lz4.frame.LZ4FrameCompressor(block_size=lz4.frame.BLOCKSIZE_MAX4MB)
    parts = [compressor.begin()]
    parts += [compressor.compress(bytes(MB)) for _ in range(megabytes)]
    return b"".join([*parts, compressor.flush()])


def zstd_zeros(megabytes: int, *, states_size: bool = False) -> bytes:
    """Return a zstd frame of zeros."""
    size = megabytes * MB if states_size else -1
    compressor = zstandard.ZstdCompressor().compressobj(size=size)
    parts = [compressor.compress(bytes(MB)) for _ in range(megabytes)]
    return b"".join([*parts, compressor.flush()])


def record(opcode: int, content: bytes) -> bytes:
    """Return an MCAP record."""
    return struct.pack("<BQ", opcode, len(content)) + content


def text(content: str) -> bytes:
    """Return a text of an MCAP record."""
    return struct.pack("<I", len(content.encode())) + content.encode()


def definition() -> str:
    """Return the definition of ArmState."""
    return describe(typestore(), ARM_STATE).text


def write_chunks(file: Path, packed: Packed, *, chunks: int = 1, indexed: bool = True) -> Path:
    """Write an MCAP file with one channel and the same chunk many times, one message in each."""
    schema = record(
        3, struct.pack("<H", 1) + text(ARM_STATE) + text("ros2msg") + text(definition())
    )
    channel = record(4, struct.pack("<HH", 1, 1) + text(STATE) + text("cdr") + struct.pack("<I", 0))
    data = bytearray(MAGIC + record(1, text("ros2") + text("")) + schema + channel)
    name, size = text(packed.compression), struct.pack("<Q", len(packed.data))
    chunk = record(6, struct.pack("<QQQI", 1, 1, packed.stated, 0) + name + size + packed.data)
    entries = record(7, struct.pack("<HIQQ", 1, 16, 1, 0))
    indexes = bytearray()
    for _ in range(chunks):
        start = len(data)
        data += chunk + entries
        where = struct.pack("<QQQQIHQQ", 1, 1, start, len(chunk), 10, 1, start + len(chunk), 37)
        sizes = struct.pack("<QQ", len(packed.data), packed.stated)
        indexes += record(8, where + name + sizes)
    data += record(15, bytes(4))
    summary_at = len(data) if indexed else 0
    if indexed:
        counts = struct.pack("<QHIIIIQQIHQ", chunks, 1, 1, 0, 0, chunks, 1, 1, 10, 1, chunks)
        data += schema + channel + indexes + record(11, counts)
    file.write_bytes(bytes(data) + record(2, struct.pack("<QQI", summary_at, 0, 0)) + MAGIC)
    return file


def write_packed_bag(bag: Path, content: bytes) -> Path:
    """Write a bag whose one file is compressed as a whole."""
    bag.mkdir()
    (bag / "run_0.mcap.zstd").write_bytes(content)
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "starting_time": {"nanoseconds_since_epoch": 1},
        "duration": {"nanoseconds": 1},
        "message_count": 1,
        "topics_with_message_count": [],
        "compression_format": "zstd",
        "compression_mode": "FILE",
        "relative_file_paths": ["run_0.mcap.zstd"],
        "files": [],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    (bag / "metadata.yaml").write_text(yaml.dump({"rosbag2_bagfile_information": information}))
    return bag


def write_defined_bag(bag: Path, messages: Iterable[Sent], definition_text: str) -> Path:
    """Write messages of /flexarm/state with a definition of ArmState that is not theirs."""
    topic = RecordedTopic(STATE, MessageDefinition(ARM_STATE, definition_text, ""))
    with BagWriter(bag, [topic]) as writer:
        for message in messages:
            writer.write(STATE, message.raw, message.time_ns, message.time_ns)
    return bag
