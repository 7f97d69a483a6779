"""Patience with other processes, which grows with how slow the machine is.

A process that is one of ten runnable ones on a core takes ten times as long. So the time of a wait
counts by the share of a core that a process gets meanwhile. What keeps a person or a rig safe has
a time of its own, which does not grow.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

_LOAD = Path("/proc/loadavg")


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
