"""Clock that a program waits by, units of stamps, and the rate that stamps tell."""

from __future__ import annotations

from typing import Protocol

NS = 1_000_000_000
"""Nanoseconds of a second."""
SAME_PERIOD = 1e-3
"""Part by which periods of one rig may differ: those of short records are less exact."""
# Periods by which the first and the last stamp may be off together.
_STAMP_ERROR = 0.5
# The clocks of a board and of a computer differ by less, as a part.
_CLOCK_ERROR = 1e-4


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
