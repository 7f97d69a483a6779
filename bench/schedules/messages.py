"""Messages of the graph, and their bytes as the middleware hands them to the recorder."""

from __future__ import annotations

import struct
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from flexarm_bags.metadata import RecordedTopic
from flexarm_bags.schema import describe, load_typestore

if TYPE_CHECKING:
    from flexarm_control.laws.law_protocol import DriveCommand
    from flexarm_core.signals import Command
    from flexarm_daq.loop.exchange import Record

COMMANDER, STATE, COMMAND = range(3)
"""Indices of the recorded topics."""
TOPICS: Final = ("/flexarm/commander", "/flexarm/state", "/flexarm/command")
_TYPES: Final = (
    "flexarm_msgs/msg/CommanderInfo",
    "flexarm_msgs/msg/ArmState",
    "flexarm_msgs/msg/MotorCommand",
)
_NS: Final = 1_000_000_000
# Encapsulation, stamp, the frame's name, padding up to a multiple of 8 behind the encapsulation.
_HEAD: Final = "<4siII8s4x"
_STATE: Final = struct.Struct(_HEAD + "Q6dQ")
_COMMAND: Final = struct.Struct(_HEAD + "2Q2d")
_LITTLE_ENDIAN: Final = b"\x00\x01\x00\x00"
_FRAME: Final = b"flexarm\0"


class State(NamedTuple):
    """One sample as a commander receives it."""

    sequence: int
    stamp_ns: int
    volts: list[float]
    drive: DriveCommand


class Answer(NamedTuple):
    """One command, and who sent it: that is not in the message."""

    sender: str
    command: Command


class Raw(NamedTuple):
    """One serialised message: see `flexarm_daq.nodes.recording.Message`."""

    topic: int
    raw: bytes
    source_ns: int
    sent_s: float
    """The same instant on the steady clock, which the message does not tell."""


@cache
def recorded_topics() -> tuple[RecordedTopic, ...]:
    """Return the recorded topics."""
    store = load_typestore({"flexarm_msgs": Path(__file__).parents[2] / "src" / "flexarm_msgs"})
    return tuple(
        RecordedTopic(name, describe(store, type_name))
        for name, type_name in zip(TOPICS, _TYPES, strict=True)
    )


def state_bytes(record: Record, volts: list[float], stamp_ns: int) -> bytes:
    """Return an ArmState."""
    return _STATE.pack(
        *_head(stamp_ns),
        record.sequence,
        *volts,
        *record.commands,
        *record.compensations,
        record.command_sequence,
    )


def command_bytes(command: Command) -> bytes:
    """Return a MotorCommand."""
    return _COMMAND.pack(
        *_head(command.stamp_ns),
        command.sequence,
        command.state_sequence,
        *command.efforts,
        *command.compensations,
    )


def commander_bytes(stamp_ns: int, node: str, law: str, *, uses_outputs: bool) -> bytes:
    """Return a CommanderInfo."""
    content = struct.pack("<iII8s", *divmod(stamp_ns, _NS), len(_FRAME), _FRAME)
    for text in (node, law):
        content += bytes(-len(content) % 4)
        content += struct.pack("<I", len(text) + 1) + text.encode() + b"\0"
    return _LITTLE_ENDIAN + content + bytes((uses_outputs,))


def _head(stamp_ns: int) -> tuple[bytes, int, int, int, bytes]:
    seconds, nanoseconds = divmod(stamp_ns, _NS)
    return _LITTLE_ENDIAN, seconds, nanoseconds, len(_FRAME), _FRAME
