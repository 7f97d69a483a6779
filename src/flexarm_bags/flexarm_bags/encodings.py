"""Encodings of messages: those of ROS 2 are read, and topics in others are left out by name."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mcap.reader import make_reader
from mcap.records import Channel
from mcap.writer import Writer

from flexarm_bags.records.layout import summary_of
from flexarm_core.bounds import BoundError, too_much, unpacked_bytes_allowed
from flexarm_core.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Iterator

_CDR = "cdr"


def foreign_topics(path: Path) -> dict[str, str]:
    """Return topic and encoding of the messages of an MCAP file that are not those of ROS 2.

    It is empty for another file, and for one without a summary.
    """
    if path.suffix != ".mcap" or path.is_dir():
        return {}
    with path.open("rb") as stream:
        try:
            summary = summary_of(stream)
        except Exception:  # noqa: BLE001 - who reads it says what is wrong with its bytes
            summary = []
    channels = [record for record in summary if isinstance(record, Channel)]
    return {
        each.topic: each.message_encoding or "nothing"
        for each in channels
        if each.message_encoding != _CDR
    }


@contextmanager
def ros_messages(path: Path) -> Iterator[Path]:
    """Yield a file as it is, or where it has other messages too a copy with those of ROS 2.

    Raises
    ------
    BagError
        If it has no messages of ROS 2.
    BoundError
        If they take more than is allowed.
    """
    foreign = foreign_topics(path)
    if not foreign:
        yield path
        return
    with TemporaryDirectory(prefix="flexarm_bag_") as folder:
        copy = Path(folder, path.name)
        if not _copied(path, copy, foreign):
            listed = ", ".join(f"{topic} ({encoding})" for topic, encoding in foreign.items())
            raise BagError(
                f"has no messages of ROS 2, but {listed}: record the topics with `ros2 bag "
                "record`, or export the numbers as CSV and identify that file"
            )
        yield copy


def _copied(path: Path, copy: Path, foreign: dict[str, str]) -> int:
    """Copy the messages of all other topics; return their number."""
    allowed = left = unpacked_bytes_allowed(path.stat().st_size)
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    count = 0
    with path.open("rb") as source, copy.open("wb") as target:
        writer = Writer(target)
        writer.start("ros2", "flexarm")
        for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
            if channel.topic in foreign or schema is None:
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            left -= len(message.data)
            if left < 0:
                raise BoundError(too_much(allowed))
            writer.add_message(
                channels[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
            count += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return count
