"""Definitions of a damaged file: which of its copies of channels and schemas are whole.

A file holds each of them twice, in a chunk and in its summary, and a channel has the hash that its
definition must have. A definition with a wrong letter would make the whole bag unreadable.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from rosbags.rosbag2.metadata import parse_qos

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import MessageDefinition, text_hash
from flexarm_core.bounds import yaml_content

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

_HASH, _QOS = "topic_type_hash", "offered_qos_profiles"


@dataclass
class Definitions:
    """Copies of the channels and schemas of a file, in the order in which they were found.

    Attributes
    ----------
    channels, schemas : dict of int to list
        Different copies by their number, each with its number of occurrences.
    """

    channels: dict[int, list[tuple[Channel, int]]] = field(default_factory=dict)
    schemas: dict[int, list[tuple[Schema, int]]] = field(default_factory=dict)

    def add_channel(self, channel: Channel) -> None:
        """Keep a copy of a channel."""
        self.channels[channel.id] = _counted(self.channels.get(channel.id, []), channel)

    def add_schema(self, schema: Schema) -> None:
        """Keep a copy of a schema."""
        self.schemas[schema.id] = _counted(self.schemas.get(schema.id, []), schema)

    def name(self, number: int) -> str:
        """Return the topic of a channel, whole or not, for messages."""
        copies = self.channels.get(number)
        return copies[0][0].topic if copies else f"the unknown channel {number}"

    def topic(self, number: int) -> RecordedTopic | None:
        """Return the topic of a channel with an undamaged definition; None without one.

        A definition is whole when it has the hash that a copy of its channel states. Where none
        has, all its copies must be equal, two or more of them if a hash is stated.
        """
        for channel, _ in self.channels.get(number, []):
            copies = self.schemas.get(channel.schema_id, [])
            stated = channel.metadata.get(_HASH, "")
            found = [(schema, definition_hash(schema)) for schema, _ in copies]
            for schema, its_hash in found:
                if its_hash == stated:
                    return _topic(channel, schema, stated)
            if len(copies) == 1 and found[0][1] is not None and (copies[0][1] > 1 or not stated):
                return _topic(channel, found[0][0], found[0][1] if stated else "")
        return None


_CopyT = TypeVar("_CopyT")


def _counted(copies: list[tuple[_CopyT, int]], new: _CopyT) -> list[tuple[_CopyT, int]]:
    if not any(copy == new for copy, _ in copies):
        return [*copies, (new, 1)]
    return [(copy, count + (copy == new)) for copy, count in copies]


def definition_hash(schema: Schema) -> str | None:
    """Return the hash of a definition, ``RIHS01_...``; None when it cannot be read."""
    try:
        return text_hash(schema.name, schema.data.decode())
    except Exception:  # noqa: BLE001 - parsers raise anything on damaged bytes
        return None


def _topic(channel: Channel, schema: Schema, type_hash: str) -> RecordedTopic:
    definition = MessageDefinition(schema.name, schema.data.decode(), type_hash)
    return RecordedTopic(channel.topic, definition, _qos(channel.metadata.get(_QOS, "")))


def _qos(text: str) -> TopicQos:
    try:
        return TopicQos.of(parse_qos(yaml_content(text)))  # type: ignore[arg-type]
    except Exception:  # noqa: BLE001 - parsers raise anything on damaged bytes
        return TopicQos()
