"""Instants of sending on this machine's steady clock, whatever the clocks of the senders say."""

from __future__ import annotations

from collections import deque

# So many messages tell the way of the quickest one; a clock that was set is forgotten as fast.
_RECENT = 200


class SendTimes:
    """Difference between a sender's clock and the steady clock here, by its last messages.

    A message comes later than it was sent, never earlier: the largest difference is that of the
    quickest message.
    """

    def __init__(self) -> None:
        self._differences_ns: deque[int] = deque(maxlen=_RECENT)

    def add(self, sent_ns: int, received_ns: int) -> None:
        """Take the instants of a message: of sending there, of receiving on the steady clock."""
        self._differences_ns.append(sent_ns - received_ns)

    def was_sent_before(self, sent_ns: int, now_ns: int) -> bool:
        """Return whether a message was sent before an instant of the steady clock.

        The first message of a sender counts as sent before.
        """
        if not self._differences_ns:
            return True
        return sent_ns <= now_ns + max(self._differences_ns)
