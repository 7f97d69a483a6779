"""Kept messages: the last one of each topic that a new record must be told again."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class KeptMessages:
    """Puts into every bag what was said before it was begun.

    The last message of a kept topic goes into a bag before the first message of any other topic,
    unless a newer one has come by then. What is older than the bag gets the time of its beginning.

    Parameters
    ----------
    topics
        The kept ones.
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
        """Take the next message and yield what is to be written, with the times.

        Parameters
        ----------
        topic, raw, time_ns
            The message and when it was sent.
        """
        if topic in self._topics:
            self._last[topic] = raw
            self._due.pop(topic, None)
            yield topic, raw, max(time_ns, self._begun_ns)
            return
        for kept, kept_raw in self._due.items():
            yield kept, kept_raw, self._begun_ns
        self._due.clear()
        yield topic, raw, time_ns
