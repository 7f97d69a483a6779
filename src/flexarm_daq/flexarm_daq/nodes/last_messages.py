"""Last messages: what a recorder in snapshot mode keeps in memory."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Collection


class Timed(NamedTuple):
    """Message of a topic as bytes, with its time of sending, nanoseconds since the epoch."""

    topic: str
    raw: bytes
    time_ns: int


class LastMessages:
    """Messages of the last seconds, counted back from the newest one.

    A latched topic holds what is in force: its last message stays when it gets too old, and has the
    time of the oldest other message then.

    Parameters
    ----------
    duration_s : float
        Time that is kept, s.
    latched : collection of str
        Latched topics.
    """

    def __init__(self, duration_s: float, latched: Collection[str]) -> None:
        self._duration_ns = duration_s * 1e9
        self._latched = frozenset(latched)
        self._messages: deque[Timed] = deque()
        self._in_force: dict[str, bytes] = {}

    def __len__(self) -> int:
        return len(self._in_force) + len(self._messages)

    def add(self, topic: str, raw: bytes, time_ns: int) -> None:
        """Take the next message, and forget those that are too old by now."""
        messages = self._messages
        messages.append(Timed(topic, raw, time_ns))
        while time_ns - messages[0].time_ns > self._duration_ns:
            self._forget(messages.popleft())

    def take(self, now_ns: int) -> list[Timed]:
        """Return what is kept, in the order of arrival, and keep what is in force only.

        Parameters
        ----------
        now_ns : int
            Instant, nanoseconds since the epoch. Messages that were sent after it tell that the
            clock was set back meanwhile: they are kept, and make no other message too old.
        """
        if not self._messages:
            return []
        # Each topic has a way of its own: an old message may have come behind a younger one.
        times_ns = (message.time_ns for message in self._messages)
        newest_ns = max((time_ns for time_ns in times_ns if time_ns <= now_ns), default=now_ns)
        taken: list[Timed] = []
        for message in self._messages:
            if newest_ns - message.time_ns <= self._duration_ns:
                taken.append(message)
            else:
                self._forget(message)
        begin_ns = min(message.time_ns for message in taken)
        first = [Timed(topic, raw, begin_ns) for topic, raw in self._in_force.items()]
        self._messages.clear()
        self._in_force |= {each.topic: each.raw for each in taken if each.topic in self._latched}
        return [*first, *taken]

    def _forget(self, message: Timed) -> None:
        if message.topic in self._latched:
            self._in_force[message.topic] = message.raw
