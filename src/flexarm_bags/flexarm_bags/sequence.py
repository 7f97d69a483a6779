"""Stamps and sequence numbers of serialised messages: reading, replacement, and gaps.

The project's samples and commands begin with a ``std_msgs/Header`` and a ``uint64`` sequence
number. Little-endian CDR has them behind 4 bytes of encapsulation: seconds, nanoseconds, the
frame's name with its length, padding up to a multiple of 8, and the number.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_bags.records.columns import ENCAPSULATION
from flexarm_core.labels import counted

if TYPE_CHECKING:
    from collections.abc import Mapping

COMMANDS = frozenset({"flexarm_msgs/msg/MotorCommand", "flexarm_msgs/msg/IoCommand"})
"""Of the types that begin so, those that number commands; the others number sampling periods."""

SEQUENCED = COMMANDS | {"flexarm_msgs/msg/ArmState", "flexarm_msgs/msg/IoSample"}
"""Types that begin so."""

_STAMP = struct.Struct("<iI")
_LENGTH = struct.Struct("<I")
_SEQUENCE = struct.Struct("<Q")
_NAME_AT = ENCAPSULATION + _STAMP.size
_NS = 1_000_000_000


def missing_text(missing: int, type_name: str, gaps: int) -> str:
    """Return in words how many numbers of a type of `SEQUENCED` are missing, at how many places."""
    lost = (
        f"{counted(missing, 'command')} missing"
        if type_name in COMMANDS
        else f"{counted(missing, 'period')} without a sample"
    )
    return f"{lost} at {counted(gaps, 'place')}"


def sequence_of(raw: bytes) -> int:
    """Return the sequence number of a message of a type of `SEQUENCED`."""
    return int(_SEQUENCE.unpack_from(raw, _sequence_at(raw))[0])


def stamp_of(raw: bytes) -> int:
    """Return the stamp of a message of a type of `SEQUENCED`, nanoseconds since the epoch."""
    sec, nanosec = _STAMP.unpack_from(raw, ENCAPSULATION)
    return int(sec * _NS + nanosec)


def restamped(raw: bytes, stamp_ns: int, sequence: int) -> bytes:
    """Return a message of a type of `SEQUENCED` with another stamp and sequence number.

    Parameters
    ----------
    raw : bytes
        Serialised message.
    stamp_ns : int
        New stamp, nanoseconds since the epoch.
    sequence : int
        New number.

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
    """Losses on one topic.

    Attributes
    ----------
    missing : int
        Numbers that were left out.
    gaps : int
        Places where numbers were left out.
    restarts : int
        Places where the numbering did not go up, because its source started again.
    """

    missing: int = 0
    gaps: int = 0
    restarts: int = 0


class SequenceCheck:
    """Sequence check of messages as they are recorded.

    Parameters
    ----------
    types : mapping of str to str
        Topic -> message type. Topics without a sequence number are not checked.
    """

    def __init__(self, types: Mapping[str, str]) -> None:
        self.losses = {topic: Losses() for topic, name in types.items() if name in SEQUENCED}
        self._types = types
        self._last: dict[str, int] = {}

    def add(self, topic: str, raw: bytes) -> None:
        """Check the next message of a topic; one that cannot be read is left to other checks."""
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

    def forget(self) -> None:
        """Take the next message of each topic as its first one: what lies between is left out."""
        self._last.clear()

    def complaints(self) -> list[str]:
        """Return one sentence per topic with missing messages.

        The numbers of samples count periods: a skipped period is missing like a lost sample.
        """
        return [
            f"{topic}: {missing_text(losses.missing, self._types[topic], losses.gaps)}"
            for topic, losses in self.losses.items()
            if losses.missing
        ]
