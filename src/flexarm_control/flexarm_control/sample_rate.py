"""Measured sampling rate, from the stamps of the samples."""

from __future__ import annotations

from itertools import pairwise
from statistics import median

_SAMPLES = 64
TOLERANCE = 0.25
"""Largest relative error of a law's rate. Late samples on a busy machine do not reach it: half of
them would have to be that late."""


class SampleRate:
    """Sampling rate by the median period of the last samples."""

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []

    def reset(self) -> None:
        """Forget the samples of an earlier run."""
        self._stamps_ns.clear()

    def add(self, stamp_ns: int) -> float | None:
        """Take the stamp of one sample, ns; return the rate in Hz once in 64 samples."""
        stamps_ns = self._stamps_ns
        stamps_ns.append(stamp_ns)
        if len(stamps_ns) <= _SAMPLES:
            return None
        period_ns = median(b - a for a, b in pairwise(stamps_ns))
        stamps_ns[:] = stamps_ns[-1:]
        return 1e9 / period_ns if period_ns > 0 else None


def suits(rate_hz: float, measured_hz: float) -> bool:
    """Return whether a law for one rate may work at another one."""
    return abs(measured_hz / rate_hz - 1.0) <= TOLERANCE
