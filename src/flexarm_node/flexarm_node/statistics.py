"""Running figures of a loop over a window, cheap enough to update at every sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Percentiles:
    """Percentiles of the values in a window; NaN while it is empty."""

    p50: float
    p99: float
    p999: float
    maximum: float


class Rate:
    """How fast a count grows, between one look at it and the next."""

    def __init__(self) -> None:
        self._count = 0
        self._time_s: float | None = None

    def update(self, count: int, time_s: float) -> float:
        """Return counts per second since the last look; NaN at the first one or without time."""
        counted, self._count = count - self._count, count
        last_s, self._time_s = self._time_s, time_s
        if last_s is None or not time_s > last_s:
            return np.nan
        return counted / (time_s - last_s)


class Window:
    """The last `size` values of one quantity."""

    def __init__(self, size: int) -> None:
        self._values = np.zeros(size)
        self._count = 0

    def add(self, value: float) -> None:
        """Add one value; the oldest one leaves a full window."""
        self._values[self._count % len(self._values)] = value
        self._count += 1

    def percentiles(self) -> Percentiles:
        """Return the percentiles of what is in the window."""
        filled = self._values[: min(self._count, len(self._values))]
        if not len(filled):
            return Percentiles(np.nan, np.nan, np.nan, np.nan)
        p50, p99, p999 = np.percentile(filled, (50.0, 99.0, 99.9))
        return Percentiles(float(p50), float(p99), float(p999), float(filled.max()))
