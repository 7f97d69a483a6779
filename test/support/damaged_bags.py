"""Recording whose chunks are known, copies of it with damage, and what is read from them."""

from __future__ import annotations

import shutil
import struct
from collections import Counter
from typing import TYPE_CHECKING

import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from flexarm_bags.writer import BagWriter
from support.bag_samples import (
    Sent,
    experiment,
    mcap_file,
    recorded_topics,
)

if TYPE_CHECKING:
    from pathlib import Path

SAMPLES = 60
MAGIC = b"\x89MCAP0\r\n"
CHUNK_OPCODE = 6
CHUNK = 16
"""Messages after which the bag is flushed."""


class Recording:
    """A whole bag in chunks, and where each chunk ends in its file."""

    def __init__(self, bag: Path) -> None:
        self.bag = bag
        self.messages = experiment(SAMPLES)
        with BagWriter(bag, recorded_topics(self.messages), flush_period_s=1e6) as writer:
            for count, message in enumerate(self.messages, start=1):
                writer.write(message.topic, message.raw, message.time_ns, message.time_ns)
                if count % CHUNK == 0:
                    writer.flush()
        self.file = mcap_file(bag)
        raw = self.file.read_bytes()
        self.chunks = chunks_of(raw)
        (self.summary_at,) = struct.unpack_from("<Q", raw, len(raw) - len(MAGIC) - 20)

    def whole_at(self, size: int) -> int:
        """Return how many messages are whole when the file is cut to a size."""
        chunks = sum(end <= size for _, end in self.chunks)
        return min(chunks * CHUNK, len(self.messages))


def chunks_of(raw: bytes) -> list[tuple[int, int]]:
    """Walk the records of an MCAP file: opcode, 8 bytes of length, content."""
    chunks = []
    position = len(MAGIC)
    while position < len(raw) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", raw, position)
        if opcode == CHUNK_OPCODE:
            chunks.append((position, position + 9 + length))
        position += 9 + length
    return chunks


def content(bag: Path) -> list[Sent]:
    with AnyReader([bag]) as reader:
        found = [
            Sent(connection.topic, connection.msgtype, time_ns, bytes(raw))
            for connection, time_ns, raw in reader.messages()
        ]
        assert reader.message_count == len(found)
    return found


def content_of_file(bag: Path) -> list[Sent]:
    """Return the content as the mcap library reads it, which is faster, beside the metadata."""
    file = mcap_file(bag)
    with file.open("rb") as stream:
        found = [
            Sent(channel.topic, schema.name, message.log_time, message.data)
            for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages()
            if schema is not None
        ]
    metadata = yaml.load((bag / "metadata.yaml").read_bytes(), yaml.CSafeLoader)
    information = metadata["rosbag2_bagfile_information"]
    counts = {
        each["topic_metadata"]["name"]: each["message_count"]
        for each in information["topics_with_message_count"]
    }
    assert {topic: each for topic, each in counts.items() if each} == Counter(
        message.topic for message in found
    )
    assert information["message_count"] == len(found)
    assert information["relative_file_paths"] == [file.name]
    return found


def damaged_copy(recording: Recording, folder: Path, raw: bytes) -> Path:
    folder.mkdir()
    shutil.copy(recording.bag / "metadata.yaml", folder)
    (folder / recording.file.name).write_bytes(raw)
    return folder
