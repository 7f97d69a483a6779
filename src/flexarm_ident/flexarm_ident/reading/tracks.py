"""Tracks: the values of one signal at the instants of its messages, by either clock.

Messages of other nodes have no numbers. Their periods are counted from the instants.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.clock import NS
from flexarm_core.errors import DataError
from flexarm_ident.reading.grid import STEADY, place
from flexarm_ident.records.signals import NORMAL_MAD

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray

    Integers = NDArray[np.int64]

# A step back by more is a clock that began anew, a smaller one messages that overtook each other.
_RESTART_NS = NS
# A step between two messages, in periods, in which others may have been lost.
_GAP = 1.5
# So many messages on either side of a gap tell how many were lost in it, and a fraction of one
# above this is one more.
_AROUND = 15
_LOST = 0.6
# The count gives the period, which the next count begins with.
_COUNTS = 3
# Fewer arrivals do not tell whether there are even instants behind them.
_FEWEST = 100
# Parts of a record that tell the drift of a clock, and the scatters that chance makes of it once in
# a thousand records.
_PARTS, _UNSURE = 10, 5.0


@dataclass(frozen=True, eq=False)
class Track:
    """Values of one signal.

    Attributes
    ----------
    label : str
        Topic and field, for messages.
    times_ns : ndarray of int, (messages,)
        Instants, rising; two or more.
    values : ndarray, (messages,)
        Finite values.
    restarts : int
        Places where the clock began anew; the longest run was taken.
    unknown : int
        Messages without a number, which have no instant here.
    """

    label: str
    times_ns: Integers
    values: FloatArray
    restarts: int = 0
    unknown: int = 0

    @property
    def period_s(self) -> float:
        """Median step."""
        return float(np.median(np.diff(self.times_ns))) / NS


class Drift(NamedTuple):
    """Time by which a clock gains on the recorder's over a record, and how much chance makes."""

    gain_s: float
    chance_s: float
    record_s: float


class Evened(NamedTuple):
    """Signal at the even instants behind its arrivals.

    Attributes
    ----------
    sent : Track
        The signal; its instants are later than those of sending by the mean delay.
    jitter_s : float
        Distance of the arrivals from these instants, RMS; 0 for what stayed as it was.
    early_s : float
        Distance of the earliest arrival: how far the mean delay is above the least one.
    """

    sent: Track
    jitter_s: float = 0.0
    early_s: float = 0.0


def track(label: str, times_ns: Integers, values: FloatArray) -> Track:
    """Return the track of a signal, in the order of time; NaN is not a value.

    Raises
    ------
    DataError
        If it has fewer than two instants.
    """
    known = ~np.isnan(values)
    times_ns, values = times_ns[known], values[known]
    cuts = np.flatnonzero(np.diff(times_ns) < -_RESTART_NS) + 1
    edges = np.concatenate([[0], cuts, [len(times_ns)]])
    longest = int(np.argmax(np.diff(edges)))
    run = slice(int(edges[longest]), int(edges[longest + 1]))
    times_ns, first = np.unique(times_ns[run], return_index=True)
    if len(times_ns) < 2:  # noqa: PLR2004 - a period needs two
        raise DataError(f"{label} has values at {len(times_ns)} instants: two or more are needed")
    return Track(label, times_ns, values[run][first], len(cuts), int(np.count_nonzero(~known)))


def advances(times_ns: Integers) -> bool:
    """Return whether a clock ran: most of its instants are new."""
    return 2 * len(np.unique(times_ns)) > len(times_ns)


def drift(stamps_ns: Integers, received_ns: Integers) -> Drift:
    """Return the drift of a clock: the line through the medians of the delays in parts of a record.

    Parameters
    ----------
    stamps_ns, received_ns : ndarray of int, (messages,)
        Instants by the clock, and by that of the recorder.
    """
    received_s = (received_ns - received_ns[0]) / NS
    record_s = float(received_s[-1])
    if len(received_s) < _FEWEST:
        return Drift(0.0, 0.0, record_s)
    parts = np.array_split(
        np.stack([received_s, (stamps_ns - stamps_ns[0]) / NS - received_s]), _PARTS, axis=1
    )
    at_s, early_s = np.array([np.median(part, axis=1) for part in parts]).T
    line = np.polyfit(at_s, early_s, 1)
    # Of ten medians the ends of the line scatter as each of them.
    chance_s = _UNSURE * float(np.std(early_s - np.polyval(line, at_s)))
    return Drift(record_s * float(line[0]), chance_s, record_s)


def counted_periods(times_ns: Integers) -> Integers:
    """Return the numbers of the periods, rising from 0, in which messages came.

    Nothing was lost when the instants scatter about one line no more than their steps do. Else the
    steps of a steady clock tell what was lost. Where they jitter too much for that, messages are
    lost in a gap when those behind it are late for good.

    Parameters
    ----------
    times_ns : ndarray of int, (messages,)
        Rising instants.
    """
    times_s = (times_ns - times_ns[0]) / NS
    order = np.arange(len(times_s))
    if _is_whole(times_s, _line(times_s)):
        return order
    if _is_steady(times_s):
        return np.concatenate([[0], np.cumsum(_whole_steps(times_s))]).astype(np.int64)
    numbers, usual_s = order, float(np.median(np.diff(times_s)))
    for _ in range(_COUNTS):
        numbers = order + np.cumsum(_lost(times_s / usual_s)).astype(np.int64)
        usual_s = float(np.polyfit(numbers, times_s, 1)[0])
    return numbers


def lost_messages(times_ns: Integers) -> int:
    """Return how many messages of a steady sender are missing; 0 where nothing shows it."""
    times_s = (times_ns - times_ns[0]) / NS
    if len(times_s) < _FEWEST or not _is_steady(times_s):
        return 0
    return int(counted_periods(times_ns)[-1]) + 1 - len(times_ns)


def evened(signal: Track) -> Evened:
    """Return a signal at the even instants behind arrivals with jitter.

    A sender with a timer sends evenly, whatever the transport does. Arrivals stay as they are when
    they are too few or too uneven to tell, as those of events are, or when some were lost and the
    others jitter too much to tell which.
    """
    start_ns = signal.times_ns[0]
    times_s = (signal.times_ns - start_ns) / NS
    line_s = _line(times_s)
    if len(times_s) >= _FEWEST and _is_whole(times_s, line_s):
        even_ns = start_ns + np.rint(NS * line_s).astype(np.int64)
        return _sent(signal, even_ns, times_s - line_s)
    if len(times_s) < _FEWEST or not _is_steady(times_s):
        return Evened(signal)
    grid = place(counted_periods(signal.times_ns), signal.times_ns)
    late_s = grid.period_s * (grid.instants - np.rint(grid.instants))
    even_ns = signal.times_ns[grid.kept] - np.rint(NS * late_s).astype(np.int64)
    even_ns, first = np.unique(even_ns, return_index=True)
    values = signal.values[grid.kept][first]
    return _sent(replace(signal, values=values), even_ns, late_s)


def _sent(signal: Track, even_ns: Integers, late_s: FloatArray) -> Evened:
    sent = replace(signal, times_ns=even_ns)
    return Evened(sent, float(np.std(late_s)), float(np.mean(late_s) - np.min(late_s)))


def _line(times_s: FloatArray) -> FloatArray:
    order = np.arange(len(times_s))
    return np.asarray(np.polyval(np.polyfit(order, times_s, 1), order))


def _is_whole(times_s: FloatArray, line_s: FloatArray) -> bool:
    """Return whether instants scatter about their line as independent ones do.

    Losses at even distances do so too, but are nearer to the line through the whole steps. A late
    message makes one of these longer and none shorter, so that all behind it are off.
    """
    off = float(np.std(times_s - line_s))
    if off > float(np.std(np.diff(times_s - line_s))):
        return False
    places = np.concatenate([[0.0], np.cumsum(_whole_steps(times_s))])
    return off <= float(np.std(times_s - np.polyval(np.polyfit(places, times_s, 1), places)))


def _whole_steps(times_s: FloatArray) -> FloatArray:
    steps_s = np.diff(times_s)
    return np.asarray(np.rint(steps_s / np.median(steps_s)).clip(min=1.0))


def _is_steady(times_s: FloatArray) -> bool:
    steps_s = np.diff(times_s)
    off = steps_s / np.median(steps_s) - _whole_steps(times_s)
    return NORMAL_MAD * float(np.median(np.abs(off))) <= STEADY


def _lost(instants: FloatArray) -> FloatArray:
    """Return how many messages were lost before each one, from instants in periods."""
    late = instants - np.arange(len(instants))
    lost = np.zeros(len(late))
    # The lateness that is left when the losses before are taken off.
    left = late.copy()
    last, counted = 0, 0.0
    for at in (np.flatnonzero(np.diff(instants) > _GAP) + 1).tolist():
        left[last:at] -= counted
        before = float(np.median(left[max(0, at - _AROUND) : at]))
        behind = float(np.median(late[at : at + _AROUND])) - counted
        lost[at] = max(0.0, np.floor(behind - before + 1.0 - _LOST))
        last, counted = at, counted + lost[at]
    return lost
