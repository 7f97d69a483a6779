"""Stamp and sequence number of a serialised message, without decoding the rest of it.

The project's samples and commands begin with a ``std_msgs/Header`` and a ``uint64`` sequence
number. In little-endian CDR that is, behind 4 bytes of encapsulation: seconds, nanoseconds, the
frame's name with its length, padding up to a multiple of 8, and the number.
"""

from __future__ import annotations

import struct

COMMANDS = frozenset({"flexarm_msgs/msg/MotorCommand"})
"""Of the types that begin so, those that number commands; the others number sampling periods."""

SEQUENCED = COMMANDS | {"flexarm_msgs/msg/ArmState", "flexarm_msgs/msg/IoSample"}
"""Types that begin so."""

_ENCAPSULATION = 4
_STAMP = struct.Struct("<iI")
_LENGTH = struct.Struct("<I")
_SEQUENCE = struct.Struct("<Q")
_NAME_AT = _ENCAPSULATION + _STAMP.size
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
    seconds, nanoseconds = _STAMP.unpack_from(raw, _ENCAPSULATION)
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
    _STAMP.pack_into(changed, _ENCAPSULATION, stamp_ns // _NS, stamp_ns % _NS)
    _SEQUENCE.pack_into(changed, _sequence_at(raw), sequence)
    return bytes(changed)


def _sequence_at(raw: bytes) -> int:
    (length,) = _LENGTH.unpack_from(raw, _NAME_AT)
    end = _NAME_AT + _LENGTH.size + int(length) - _ENCAPSULATION
    return _ENCAPSULATION + -(-end // _SEQUENCE.size) * _SEQUENCE.size
