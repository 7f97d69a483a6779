"""Samples and declarations of a recorded bag."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def declarations(bag: Path) -> list[tuple[str, str, bool]]:
    """Return who commanded, by which law, and whether that uses the outputs, as recorded."""
    with AnyReader([bag]) as reader:
        connections = [each for each in reader.connections if each.topic == "/flexarm/commander"]
        messages: list[Any] = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages(connections)
        ]
    return [(message.node, message.law, message.uses_outputs) for message in messages]


def answered_samples(bag: Path) -> list[int]:
    """Return the number of the sample that each recorded command answers."""
    with AnyReader([bag]) as reader:
        connections = [each for each in reader.connections if each.topic == "/flexarm/command"]
        messages: list[Any] = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages(connections)
        ]
    return [int(message.state_sequence) for message in messages]


class States:
    """Samples of a bag, as recorded."""

    def __init__(self, bag: Path, topic: str = "/flexarm/state") -> None:
        with AnyReader([bag]) as reader:
            connections = [each for each in reader.connections if each.topic == topic]
            messages: list[Any] = [
                reader.deserialize(raw, connection.msgtype)
                for connection, _, raw in reader.messages(connections)
            ]
        self.sequence = np.array([message.sequence for message in messages], dtype=np.int64)
        self.command_sequence = np.array([m.command_sequence for m in messages], dtype=np.int64)
        stamps = [message.header.stamp for message in messages]
        self.stamp_s = np.array([stamp.sec + stamp.nanosec * 1e-9 for stamp in stamps])
        names = (
            "position_v",
            "base_strain_v",
            "middle_strain_v",
            "speed_v",
            "command_v",
            "compensation_v",
        )
        self.volts: NDArray[np.float64] = np.array(
            [[getattr(message, name) for name in names] for message in messages]
        )

    @property
    def command_v(self) -> NDArray[np.float64]:
        """Command in force at each sample, V."""
        return self.volts[:, 4]


def content(bag: Path) -> dict[str, list[bytes]]:
    """Return the serialised messages of a bag by topic."""
    found: dict[str, list[bytes]] = {}
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(bytes(raw))
    return found


def salvaged(file: Path) -> list[bytes]:
    """Return the payloads of all whole chunks of a file that may be cut."""
    found: list[bytes] = []
    with file.open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        try:
            found.extend(record.data for record in records if isinstance(record, Message))
        except Exception:  # noqa: BLE001 - any error is the end of what is whole
            return found
    return found
