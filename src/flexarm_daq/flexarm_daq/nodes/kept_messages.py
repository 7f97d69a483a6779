"""Kept messages: the last message of each topic that a new record repeats."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class KeptMessages:
    """Store of messages that were sent before a bag and belong into it.

    The last message of a kept topic goes into a bag before the first message of any other topic,
    unless a newer one has come by then. A message that is older than the bag gets the time of its
    beginning.

    Parameters
    ----------
    topics : iterable of str
        Kept topics.
    """

    def __init__(self, topics: Iterable[str]) -> None:
        self._topics = frozenset(topics)
        self._last: dict[str, bytes] = {}
        self._due: dict[str, bytes] = {}
        self._begun_ns = 0

    def open(self, now_ns: int) -> None:
        """Begin a bag at an instant, nanoseconds since the epoch."""
        self._begun_ns = now_ns
        self._due = dict(self._last)

    def due(self, topic: str, raw: bytes, time_ns: int) -> Iterator[tuple[str, bytes, int]]:
        """Take the next message with its time of sending, and yield the messages to be written."""
        if topic in self._topics:
            self._last[topic] = raw
            self._due.pop(topic, None)
            yield topic, raw, max(time_ns, self._begun_ns)
            return
        for kept, kept_raw in self._due.items():
            yield kept, kept_raw, self._begun_ns
        self._due.clear()
        yield topic, raw, time_ns
