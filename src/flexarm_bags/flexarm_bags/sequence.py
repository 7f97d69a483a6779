"""Stamps and sequence numbers of serialised messages: read, replaced, and watched for gaps.

The project's samples and commands begin with a ``std_msgs/Header`` and a ``uint64`` sequence
number. In little-endian CDR that is, behind 4 bytes of encapsulation: seconds, nanoseconds, the
frame's name with its length, padding up to a multiple of 8, and the number.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_bags.columns import ENCAPSULATION

if TYPE_CHECKING:
    from collections.abc import Mapping

COMMANDS = frozenset({"flexarm_msgs/msg/MotorCommand"})
"""Of the types that begin so, those that number commands; the others number sampling periods."""

SEQUENCED = COMMANDS | {"flexarm_msgs/msg/ArmState", "flexarm_msgs/msg/IoSample"}
"""Types that begin so."""

_STAMP = struct.Struct("<iI")
_LENGTH = struct.Struct("<I")
_SEQUENCE = struct.Struct("<Q")
_NAME_AT = ENCAPSULATION + _STAMP.size
_NS = 1_000_000_000


def stamp_of(raw: bytes) -> int:
    """Return the stamp of a message, nanoseconds since the epoch.

    Parameters
    ----------
    raw : bytes
        Serialised message of a type of `SEQUENCED`.

    Raises
    ------
    struct.error
        If the message is too short.
    """
    seconds, nanoseconds = _STAMP.unpack_from(raw, ENCAPSULATION)
    return int(seconds) * _NS + int(nanoseconds)


def sequence_of(raw: bytes) -> int:
    """Return the sequence number of a message.

    Parameters
    ----------
    raw : bytes
        Serialised message of a type of `SEQUENCED`.

    Raises
    ------
    struct.error
        If the message is too short.
    """
    return int(_SEQUENCE.unpack_from(raw, _sequence_at(raw))[0])


def restamped(raw: bytes, stamp_ns: int, sequence: int) -> bytes:
    """Return a message with another stamp and sequence number.

    Parameters
    ----------
    raw : bytes
        Serialised message of a type of `SEQUENCED`.
    stamp_ns : int
        Nanoseconds since the epoch.
    sequence : int
        Number.

    Raises
    ------
    struct.error
        If the message is too short.
    """
    changed = bytearray(raw)
    _STAMP.pack_into(changed, ENCAPSULATION, stamp_ns // _NS, stamp_ns % _NS)
    _SEQUENCE.pack_into(changed, _sequence_at(raw), sequence)
    return bytes(changed)


def _sequence_at(raw: bytes) -> int:
    (length,) = _LENGTH.unpack_from(raw, _NAME_AT)
    end = _NAME_AT + _LENGTH.size + int(length) - ENCAPSULATION
    return ENCAPSULATION + -(-end // _SEQUENCE.size) * _SEQUENCE.size


@dataclass
class Losses:
    """What is missing on one topic.

    Attributes
    ----------
    missing
        Numbers that were left out.
    gaps
        Places where numbers were left out.
    restarts
        Places where the numbering did not go up: its source started again.
    """

    missing: int = 0
    gaps: int = 0
    restarts: int = 0


class SequenceCheck:
    """Watches the sequence numbers of messages as they are recorded.

    Parameters
    ----------
    types
        Topic -> message type. Topics without a sequence number are let pass.
    """

    def __init__(self, types: Mapping[str, str]) -> None:
        self.losses = {topic: Losses() for topic, name in types.items() if name in SEQUENCED}
        self._what = {
            topic: "commands missing" if name in COMMANDS else "periods without a sample"
            for topic, name in types.items()
        }
        self._last: dict[str, int] = {}

    def add(self, topic: str, raw: bytes) -> None:
        """Look at the next message of a topic; one that cannot be read is somebody else's case."""
        losses = self.losses.get(topic)
        if losses is None:
            return
        try:
            sequence = sequence_of(raw)
        except struct.error:
            return
        step = sequence - self._last.get(topic, sequence - 1)
        if step > 1:
            losses.missing += step - 1
            losses.gaps += 1
        elif step < 1:
            losses.restarts += 1
        self._last[topic] = sequence

    def complaints(self) -> list[str]:
        """Return one sentence per topic with missing messages.

        The numbers of samples count periods: one that was skipped is missing like one that was
        lost.
        """
        return [
            f"{topic}: {losses.missing} {self._what[topic]} at {losses.gaps} places"
            for topic, losses in self.losses.items()
            if losses.missing
        ]
