"""Reports on `/diagnostics`: named so that two arms, and two nodes of one, are told apart.

A report of a loop is put together in pieces, as bytes (CDR, XCDR version 1): rclpy would convert
the message as a whole, and keep the interpreter for half of a period at 2 kHz.
"""

from __future__ import annotations

import time
from enum import IntEnum
from functools import lru_cache
from struct import Struct
from typing import TYPE_CHECKING, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from flexarm_node import qos
from flexarm_node.stamps import stamp_members, stamp_text
from flexarm_node.topics.layout import ENCAPSULATION

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rclpy.node import Node

_STAMP = Struct("<iI")
_COUNT = Struct("<I")
_ALIGNED = 4


class Level(IntEnum):
    """Level of a DiagnosticStatus."""

    OK = DiagnosticStatus.OK[0]
    WARN = DiagnosticStatus.WARN[0]
    ERROR = DiagnosticStatus.ERROR[0]


class Report(NamedTuple):
    """What a node says of itself; the entries are made by `entries`."""

    level: Level
    message: str
    entries: Iterable[bytes] = ()


def entries(values: Mapping[str, object]) -> list[bytes]:
    """Return the bytes of each key with its value as a KeyValue."""
    return [_key(key) + _text(str(value)) for key, value in values.items()]


def report_bytes(report: Report, name: str, hardware_id: str, now_ns: int) -> bytes:
    """Return the bytes of a DiagnosticArray with one status.

    Parameters
    ----------
    report : Report
        Level, message and entries.
    name, hardware_id : str
        Those of the status.
    now_ns : int
        Stamp, ns.
    """
    listed = list(report.entries)
    texts = (_text(text) for text in (name, report.message, hardware_id))
    parts = (
        *(ENCAPSULATION, _STAMP.pack(*stamp_members(now_ns)), _text("")),
        *(_COUNT.pack(1), bytes([report.level]).ljust(_ALIGNED, b"\0"), *texts),
        *(_COUNT.pack(len(listed)), *listed),
    )
    return b"".join(parts)


def _text(text: str) -> bytes:
    """Return a text behind its length, filled up for the number that follows."""
    raw = text.encode() + b"\0"
    return _COUNT.pack(len(raw)) + raw + bytes(-len(raw) % _ALIGNED)


_key = lru_cache(maxsize=256)(_text)


class Reporter:
    """Publisher of one node's status.

    Parameters
    ----------
    node : Node
        Its full name is that of the status, its namespace the arm.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", qos.SENT)

    def publish(self, report: Report, now_ns: int, rig: str = "") -> None:
        """Publish a report, with the arm and the rig of the node as its hardware.

        Its stamp is of the clock that stamps the node's other messages. The wall clock, of which
        the arm's time in virtual time falls behind or runs ahead, is an entry.
        """
        name = self._node.get_fully_qualified_name()
        hardware_id = f"{self._node.get_namespace()} {rig}".strip()
        wall = entries({"wall clock s": stamp_text(time.time_ns())})
        # `_replace` would leave a tuple more in the interpreter's store each time.
        report = Report(report.level, report.message, [*report.entries, *wall])
        self._publisher.publish(report_bytes(report, name, hardware_id, now_ns))
