"""Instants of sending on this machine's steady clock, whatever the clocks of the senders say."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

_NS = 1_000_000_000
# A recorder that is behind has no quick message meanwhile: those of the seconds before tell.
_RECENT_S = 30
# What seems longer on the way than this comes from a clock that was set back.
_LONGEST_WAY_NS = 5 * _NS


class _Quickest(NamedTuple):
    """Difference of the quickest message of one second of the steady clock."""

    second: int
    difference_ns: int


class SendTimes:
    """Difference between a sender's clock and the steady clock here, by its messages.

    A message comes later than it was sent, never earlier: the largest difference is that of the
    quickest message.
    """

    def __init__(self) -> None:
        self._quickest: deque[_Quickest] = deque()
        self._difference_ns = 0

    def add(self, sent_ns: int, received_ns: int) -> None:
        """Take the instants of a message: of sending there, of receiving on the steady clock."""
        second, difference_ns = received_ns // _NS, sent_ns - received_ns
        if difference_ns < self._difference_ns - _LONGEST_WAY_NS:
            self._quickest.clear()
        if not self._quickest or self._quickest[-1].second != second:
            self._quickest.append(_Quickest(second, difference_ns))
        elif difference_ns > self._quickest[-1].difference_ns:
            self._quickest[-1] = _Quickest(second, difference_ns)
        else:
            return
        while self._quickest[0].second < second - _RECENT_S:
            self._quickest.popleft()
        self._difference_ns = max(each.difference_ns for each in self._quickest)

    def was_sent_before(self, sent_ns: int, now_ns: int) -> bool:
        """Return whether a message was sent before an instant of the steady clock.

        The first message of a sender counts as sent before.
        """
        if not self._quickest:
            return True
        return sent_ns <= now_ns + self._difference_ns
