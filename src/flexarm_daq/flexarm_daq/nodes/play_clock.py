"""Clock of a play that can be stopped and started, with the numbers and stamps of its messages."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from flexarm_bags.sequence import restamped, sequence_of

if TYPE_CHECKING:
    from collections.abc import Callable


class Pacer:
    """Clock that a thread waits for, and that other threads stop, start and end.

    Parameters
    ----------
    running : bool
        False: stopped until the first `start`.
    clock : callable
        Monotonic time in seconds.
    """

    def __init__(
        self, *, running: bool = True, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock = clock
        self._condition = threading.Condition()
        self._played_s = 0.0
        self._since_s = clock() if running else None
        self._ended = False

    @property
    def position_s(self) -> float:
        """Time played so far, without the time in which the play was stopped, s."""
        since_s = self._since_s
        return self._played_s + (0.0 if since_s is None else self._clock() - since_s)

    @property
    def running(self) -> bool:
        """False while the play is stopped."""
        return self._since_s is not None

    def start(self) -> None:
        """Go on; has no effect on a running play."""
        with self._condition:
            if self._since_s is None:
                self._since_s = self._clock()
            self._condition.notify_all()

    def stop(self) -> None:
        """Stop at the present position, until `start`."""
        with self._condition:
            self._played_s = self.position_s
            self._since_s = None
            self._condition.notify_all()

    def end(self) -> None:
        """End the play for good; every waiting thread returns."""
        with self._condition:
            self._ended = True
            self._condition.notify_all()

    def wait_for(self, due_s: float) -> bool:
        """Wait until the play has reached an instant; return False when it was ended instead."""
        with self._condition:
            while not self._ended:
                left_s = due_s - self.position_s
                if self.running and left_s <= 0.0:
                    return True
                self._condition.wait(left_s if self.running else None)
        return False


class StandIn:
    """Renewal of recorded samples, so that they look as if they were taken now.

    Stamps follow the play from its beginning. The numbering goes on where the record starts again,
    and gaps in the record stay.

    Parameters
    ----------
    start_ns : int
        Instant at which the play began, nanoseconds since the epoch.
    """

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._offset = 0
        self._last = 0

    def sample(self, raw: bytes, due_s: float) -> bytes:
        """Return the next sample with its new stamp and number.

        Raises
        ------
        struct.error
            If the message is too short for a sample.
        """
        recorded = sequence_of(raw)
        number = recorded + self._offset
        if number <= self._last:
            number = self._last + 1
            self._offset = number - recorded
        self._last = number
        return restamped(raw, self._start_ns + round(due_s * 1e9), number)
