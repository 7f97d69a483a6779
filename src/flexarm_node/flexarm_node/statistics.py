"""Counts and running figures of a loop, cheap enough to update at every sample."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass

import numpy as np

_FINEST_S = 1e-6
_BIN = math.log(1.01)
_LONGEST_S = 1e3
_BINS = math.ceil(math.log(_LONGEST_S / _FINEST_S) / _BIN)
_SHARES = np.array([0.5, 0.99, 0.999, 1.0])
HISTOGRAM_EDGES_S = np.geomspace(1e-5, 0.1, 25)
"""Edges of the bars of a histogram of durations."""
_MIDDLES_S = _FINEST_S * np.exp(_BIN * (np.arange(_BINS) + 0.5))
_BARS = len(HISTOGRAM_EDGES_S) - 1
_BAR_OF_BIN = np.clip(np.searchsorted(HISTOGRAM_EDGES_S, _MIDDLES_S) - 1, 0, _BARS - 1)
# A number or a stamp that goes back further is that of a new run.
_LATEST_SAMPLES = 100
_LATEST_NS = 1_000_000_000


@dataclass(frozen=True)
class Percentiles:
    """Percentiles of the durations in a window, s; NaN while it is empty."""

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
    """The last `size` durations, counted in bins of 1 %.

    Adding one and reading the percentiles takes the same short time whatever the size.
    """

    def __init__(self, size: int) -> None:
        self._bins = array("H", bytes(array("H").itemsize * size))
        self._counts = array("q", bytes(array("q").itemsize * _BINS))
        self._added = 0

    def add(self, duration_s: float) -> None:
        """Add one duration in s; the oldest one leaves a full window.

        Less than 1 us counts as 1 us, more than 1000 s as 1000 s.
        """
        place = self._added % len(self._bins)
        if self._added >= len(self._bins):
            self._counts[self._bins[place]] -= 1
        seen_s = min(max(duration_s, _FINEST_S), _LONGEST_S)
        bin_ = min(int(math.log(seen_s / _FINEST_S) / _BIN), _BINS - 1)
        self._bins[place] = bin_
        self._counts[bin_] += 1
        self._added += 1

    def percentiles(self) -> Percentiles:
        """Return the percentiles of what is in the window, to half a percent."""
        if not self._added:
            return Percentiles(np.nan, np.nan, np.nan, np.nan)
        up_to = np.cumsum(np.frombuffer(self._counts, np.int64))
        ranks = np.ceil(_SHARES * up_to[-1])
        middles = np.searchsorted(up_to, ranks) + 0.5
        return Percentiles(*(_FINEST_S * np.exp(_BIN * middles)).tolist())

    def histogram(self) -> list[int]:
        """Return how many durations lie between two of `HISTOGRAM_EDGES_S` each.

        What is shorter or longer than all edges counts in the first or in the last bar.
        """
        counts = np.bincount(_BAR_OF_BIN, np.frombuffer(self._counts, np.int64), _BARS)
        return list(map(int, counts))


class AnswerCount:
    """Numbers of a commander: it sends one command, with the next number, for each sample.

    Attributes
    ----------
    run_start_ns : int
        Stamp of the first sample of the run, ns.
    answered : int
        Commands sent, in all runs.
    skipped : int
        Periods without a sample here, in all runs.
    """

    def __init__(self) -> None:
        self.run_start_ns = 0
        self.answered = 0
        self.skipped = 0
        self._command = 0
        self._sample = 0
        self._taken_ns = 0

    def restart(self) -> None:
        """Begin the numbers anew: the node was activated, and the next sample begins a run."""
        self._command = self._sample = 0

    def is_new(self, sequence: int, taken_ns: int) -> bool:
        """Return whether a sample is to be answered, by its number and its stamp.

        One that comes twice, or behind a newer one of the run, is not: a second answer would look
        like that of a second commander.
        """
        is_behind = 0 <= self._sample - sequence <= _LATEST_SAMPLES
        return not (is_behind and 0 <= self._taken_ns - taken_ns <= _LATEST_NS)

    def begins(self, sequence: int, taken_ns: int) -> bool:
        """Take the number and the stamp of a sample; return whether it begins a run.

        The first sample does, and so does one whose number is not above that of the last one.
        """
        is_first = sequence <= self._sample or self._sample == 0
        if is_first:
            self.run_start_ns, self._sample = taken_ns, sequence - 1
        self.skipped += sequence - self._sample - 1
        self._sample, self._taken_ns = sequence, taken_ns
        return is_first

    @property
    def upcoming(self) -> int:
        """Number of the next command."""
        return self._command + 1

    def next(self) -> int:
        """Return the number of the next command, which is sent."""
        self.answered += 1
        self._command += 1
        return self._command
