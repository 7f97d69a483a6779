"""Limits on what a client may send, and on what waits for it."""

from __future__ import annotations

from collections import deque

LARGEST_MESSAGE = 64_000
LARGEST_FILE = 200_000_000
"""Bytes of a file that is dropped on the page, in messages of the above size."""
MOST_A_SECOND = 200
MOST_WAITING = 4_000_000
"""Bytes that wait for a client before it is dropped, beside the buffers of the system."""
MOST_CLIENTS = 16
MOST_AT_WORK = 16
"""Requests of one client that are at work at a time."""


class RateLimit:
    """Count of the messages of one client in the last second."""

    def __init__(self, most: int = MOST_A_SECOND) -> None:
        self._times_s: deque[float] = deque(maxlen=most)

    def allows(self, now_s: float) -> bool:
        """Take one message; return whether it and those before are few enough."""
        times_s = self._times_s
        is_full = len(times_s) == times_s.maxlen and now_s - times_s[0] < 1.0
        times_s.append(now_s)
        return not is_full


class Outbox:
    """Messages that wait for one client, bounded by their size."""

    def __init__(self, most_bytes: int = MOST_WAITING) -> None:
        self._messages: deque[str | bytes] = deque()
        self._most_bytes = most_bytes
        self.waiting_bytes = 0

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, message: str | bytes) -> bool:
        """Add a message; return False, and leave it out, when there is no room."""
        if self.waiting_bytes + len(message) > self._most_bytes:
            return False
        self.waiting_bytes += len(message)
        self._messages.append(message)
        return True

    def take(self) -> str | bytes:
        """Return the oldest message, which no longer waits."""
        message = self._messages.popleft()
        self.waiting_bytes -= len(message)
        return message
