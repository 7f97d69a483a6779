"""Clock that a program waits by."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """Steady time: the module `time`, or a clock that a simulation moves."""

    def monotonic(self) -> float:
        """Return the time, s."""

    def sleep(self, seconds: float, /) -> None:
        """Return when some seconds have passed."""
