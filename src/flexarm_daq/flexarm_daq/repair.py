"""Repair of a damaged bag: every whole message is copied into a new one.

An MCAP file that was cut has no index, so readers refuse it; what it holds is in whole chunks, each
with a checksum, and these can be read one after the other until the damage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mcap.records import Channel, Message, Schema, Statistics
from mcap.stream_reader import StreamReader

from flexarm_daq.bag_metadata import RecordedTopic, TopicQos
from flexarm_daq.definitions import MessageDefinition
from flexarm_daq.recording import BagWriter, RecordingError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


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
        What ended the reading; empty when the file was whole.
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
    """Yield the messages of each file up to its damage, which is noted."""
    for file in files:
        yield from _up_to_damage(file, [] if damage is None else damage)


def _up_to_damage(file: Path, damage: list[str]) -> Iterator[tuple[RecordedTopic, Message]]:
    try:
        yield from _messages(file)
    except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
        cause = " ".join(str(error).split()) or type(error).__name__
        damage.append(f"{file.name}: {cause}")


def _messages(file: Path) -> Iterator[tuple[RecordedTopic, Message]]:
    topics: dict[int, RecordedTopic] = {}
    schemas: dict[int, Schema] = {}
    count = 0
    with file.open("rb") as stream:
        limit = file.stat().st_size
        for record in StreamReader(stream, validate_crcs=True, record_size_limit=limit).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                topics[record.id] = _topic(record, schemas[record.schema_id])
            elif isinstance(record, Message):
                yield topics[record.channel_id], record
                count += 1
            elif isinstance(record, Statistics) and record.message_count != count:
                # A chunk whose kind was overwritten is passed over without an error.
                raise RecordingError(f"{count} of {record.message_count} messages found")


def _topic(channel: Channel, schema: Schema) -> RecordedTopic:
    latched = "transient_local" in channel.metadata.get("offered_qos_profiles", "")
    return RecordedTopic(
        channel.topic,
        MessageDefinition(
            schema.name, schema.data.decode(), channel.metadata.get("topic_type_hash", "")
        ),
        TopicQos(durability="transient_local" if latched else "volatile"),
    )
