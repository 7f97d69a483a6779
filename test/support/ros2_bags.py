"""Bags as `ros2 bag record` of Humble and Jazzy lays them out, written with the mcap library.

They differ from our own: log time is the instant at which the recorder got a message, chunks are
large, the metadata states the QoS as the recorder knows it, and the files may be split or
compressed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import yaml
import zstandard
from mcap.writer import CompressionType, Writer

from support.bag_samples import recorded_topics

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from support.bag_samples import Sent

RECEIVED_NS = 350_000
"""From sending to receiving."""


@dataclass(frozen=True)
class Layout:
    """Way to record."""

    version: int = 9
    compression: CompressionType = CompressionType.ZSTD
    chunked: bool = True
    checksums: bool = True
    parts: int = 1
    compressed_files: bool = False


LAYOUTS = {
    "jazzy": Layout(),
    "humble": Layout(version=5),
    "lz4": Layout(compression=CompressionType.LZ4),
    "fastwrite": Layout(compression=CompressionType.NONE, chunked=False, checksums=False),
    "uncompressed": Layout(compression=CompressionType.NONE, checksums=False),
    "split": Layout(parts=3),
    "compressed_files": Layout(compression=CompressionType.NONE, parts=2, compressed_files=True),
}


def write_ros2_bag(path: Path, messages: Sequence[Sent], layout: Layout) -> Path:
    """Write messages as `ros2 bag record` would have."""
    path.mkdir(parents=True)
    size = -(-len(messages) // layout.parts)
    names, files = [], []
    for number in range(layout.parts):
        part = messages[number * size : (number + 1) * size]
        file = path / f"{path.name}_{number}.mcap"
        _write_file(file, messages, part, layout)
        if layout.compressed_files:
            packed = zstandard.ZstdCompressor().compress(file.read_bytes())
            file.unlink()
            file = file.with_name(file.name + ".zstd")
            file.write_bytes(packed)
        names.append(file.name)
        files.append({"path": file.name, **_extent(part)})
    _write_metadata(path, messages, layout, names, files)
    return path


def _write_file(file: Path, messages: Sequence[Sent], part: Sequence[Sent], layout: Layout) -> None:
    with file.open("wb") as stream:
        writer = Writer(
            stream,
            chunk_size=786_432,
            compression=layout.compression,
            use_chunking=layout.chunked,
            enable_crcs=layout.checksums,
        )
        writer.start(profile="ros2", library="libmcap 1.1.0")
        channels = {}
        for topic in recorded_topics(messages):
            definition = topic.definition
            schema = writer.register_schema(
                definition.type_name, "ros2msg", definition.text.encode()
            )
            metadata = {"offered_qos_profiles": yaml.safe_dump(_qos(layout))}
            if layout.version >= 8:
                metadata["topic_type_hash"] = definition.type_hash
            channels[topic.name] = writer.register_channel(topic.name, "cdr", schema, metadata)
        for number, message in enumerate(part):
            writer.add_message(
                channels[message.topic],
                message.time_ns + RECEIVED_NS,
                message.raw,
                message.time_ns,
                number,
            )
        writer.add_metadata("rosbag2", {"serialized_metadata": yaml.safe_dump(_extent(part))})
        writer.finish()  # type: ignore[no-untyped-call]


def _extent(part: Sequence[Sent]) -> dict[str, object]:
    times_ns = [message.time_ns + RECEIVED_NS for message in part]
    return {
        "starting_time": {"nanoseconds_since_epoch": min(times_ns)},
        "duration": {"nanoseconds": max(times_ns) - min(times_ns)},
        "message_count": len(part),
    }


def _qos(layout: Layout) -> list[dict[str, object]]:
    infinite = {"sec": 9223372036, "nsec": 854775807}
    by_name = layout.version >= 9
    return [
        {
            "history": "unknown" if by_name else 3,
            "depth": 0,
            "reliability": "reliable" if by_name else 1,
            "durability": "volatile" if by_name else 2,
            "deadline": dict(infinite),
            "lifespan": dict(infinite),
            "liveliness": "automatic" if by_name else 1,
            "liveliness_lease_duration": dict(infinite),
            "avoid_ros_namespace_conventions": False,
        }
    ]


def _write_metadata(
    path: Path,
    messages: Sequence[Sent],
    layout: Layout,
    names: list[str],
    files: list[dict[str, object]],
) -> None:
    topics = []
    for topic in recorded_topics(messages):
        metadata = {
            "name": topic.name,
            "type": topic.definition.type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": (
                _qos(layout) if layout.version >= 9 else yaml.safe_dump(_qos(layout))
            ),
        }
        if layout.version >= 8:
            metadata["type_description_hash"] = topic.definition.type_hash
        count = sum(message.topic == topic.name for message in messages)
        topics.append({"topic_metadata": metadata, "message_count": count})
    information = {
        "version": layout.version,
        "storage_identifier": "mcap",
        **_extent(messages),
        "topics_with_message_count": topics,
        "compression_format": "zstd" if layout.compressed_files else "",
        "compression_mode": "FILE" if layout.compressed_files else "",
        "relative_file_paths": names,
        "files": files,
    }
    if layout.version >= 8:
        information |= {"custom_data": None, "ros_distro": "jazzy"}
    text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
    (path / "metadata.yaml").write_text(text, "utf-8")
