"""Clock and patience that a program waits by, units of stamps, and the rate that stamps tell.

A process that is one of ten runnable ones on a core takes ten times as long. So the time of a wait
counts by the share of a core that a process gets meanwhile. What keeps a person or a rig safe has
a time of its own, which does not grow.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Protocol

NS = 1_000_000_000
"""Nanoseconds of a second."""
SAME_PERIOD = 1e-3
"""Part by which periods of one rig may differ: those of short records are less exact."""
# Periods by which the first and the last stamp may be off together.
_STAMP_ERROR = 0.5
# The clocks of a board and of a computer differ by less, as a part.
_CLOCK_ERROR = 1e-4
_LOAD = Path("/proc/loadavg")


class Clock(Protocol):
    """Steady time: the module `time`, or a clock that a simulation moves."""

    def monotonic(self) -> float:
        """Return the time, s."""

    def sleep(self, seconds: float, /) -> None:
        """Return when some seconds have passed."""


def nominal_rate_hz(rate_hz: float, periods: float) -> float:
    """Return a measured rate, or the whole number of hertz that it cannot be told from.

    Parameters
    ----------
    rate_hz : float
        Rate by the stamps of a record.
    periods : float
        Periods from the first stamp to the last.
    """
    whole_hz = float(round(rate_hz))
    allowed = min(max(_CLOCK_ERROR, _STAMP_ERROR / periods), SAME_PERIOD)
    near = whole_hz > 0.0 and abs(rate_hz - whole_hz) <= allowed * rate_hz
    return whole_hz if near else rate_hz


def slowness() -> float:
    """Return how many times longer work takes than on an idle machine, at least 1.

    It is the number of runnable threads per core of now, where the system reports it, and of the
    last minute elsewhere.
    """
    try:
        runnable = float(_LOAD.read_text("ascii").split()[3].partition("/")[0])
    except (OSError, ValueError, LookupError):
        runnable = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return max(1.0, runnable / (cores or 1))


class Patience:
    """Time of one wait, counted by the share of a core that others get meanwhile.

    Parameters
    ----------
    longest_s : float
        Longest wait on an idle machine, s; infinity never ends.
    """

    def __init__(self, longest_s: float) -> None:
        self._longest_s = longest_s
        self._began_s = self._looked_s = time.monotonic()
        self._counted_s = 0.0

    @property
    def waited_s(self) -> float:
        """Time since the begin, by the clock, s."""
        return time.monotonic() - self._began_s

    @property
    def is_over(self) -> bool:
        """Whether the wait has taken too long. The oftener asked, the better it counts."""
        now_s = time.monotonic()
        self._counted_s += (now_s - self._looked_s) / slowness()
        self._looked_s = now_s
        return self._counted_s > self._longest_s
