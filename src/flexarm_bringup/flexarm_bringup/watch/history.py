"""History of the samples: the band of every channel in each tenth of a second."""

from __future__ import annotations

import math
from collections import deque
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

COLUMN_S = 0.1
_MOST_COLUMNS = 1000
_CLOCK_S = 1e-6
"""Stamps are sums of rounded periods."""


class Band(NamedTuple):
    """Smallest and largest value of a channel; NaN where there is none."""

    low: float
    high: float


NO_BAND = Band(math.nan, math.nan)


class History:
    """Bands of the channels, oldest first; a vibration keeps its width however it is sampled.

    Attributes
    ----------
    newest : dict of str to float
        Values of the newest sample.
    """

    def __init__(self) -> None:
        self.newest: dict[str, float] = {}
        self._number: int | None = None
        self._columns: deque[dict[str, Band]] = deque(maxlen=_MOST_COLUMNS)

    def add(self, times_s: Sequence[float], values: Mapping[str, Sequence[float | None]]) -> None:
        """Add samples in the order of their instants; a clock that goes back begins anew."""
        for row, time_s in enumerate(times_s):
            sample = {
                name: math.nan if (value := column[row]) is None else value
                for name, column in values.items()
            }
            self._move_to(math.floor((time_s + _CLOCK_S) / COLUMN_S))
            column = self._columns[-1]
            for name, value in sample.items():
                column[name] = _wider(column.get(name, NO_BAND), value)
            self.newest = sample

    def bands(self, name: str, most: int) -> list[Band]:
        """Return the newest bands of a channel."""
        columns = islice(self._columns, max(0, len(self._columns) - most), None)
        return [column.get(name, NO_BAND) for column in columns]

    def _move_to(self, number: int) -> None:
        """Make the column of a number the last one, after empty ones where samples are missing."""
        before = self._number
        if before is None or number < before:
            self._columns.clear()
            before = number - 1
        self._columns.extend({} for _ in range(min(number - before, _MOST_COLUMNS)))
        self._number = number


def _wider(band: Band, value: float) -> Band:
    if math.isnan(value):
        return band
    if math.isnan(band.low):
        return Band(value, value)
    return Band(min(band.low, value), max(band.high, value))
