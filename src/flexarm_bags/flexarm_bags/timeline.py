"""Timeline of recorded samples: gaps by numbers and times, and steps of the clocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.sequence import missing_text
from flexarm_core.labels import counted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Integers = NDArray[np.int64]

_NS = 1_000_000_000
# The earliest of so many samples in a row is on time.
_SOON = 8
# A step of the lateness by this part of a period is one that may stay.
_STEP = 0.25
# A sample may be late by almost a period: only what is above counts as whole ones.
_EARLY = 0.3
# Steps back from which on, and the share of them with which, two sources take turns; one answers
# a sample so many messages after its last answer at most.
_TURNS = 5
_MOSTLY = 0.8
_NEAR = 3
# A step of one clock against the other, from one sample to the next, that no delay explains.
_CLOCK_STEP_NS = _NS
# Steps of stamps that are whole periods, each rounded to whole nanoseconds: no clock does that.
_ROUNDING_NS = 2
# In virtual time the stamps run much faster than the clock that the messages are sent by.
_REAL_TIME = 0.2


def restarts(sequences: Integers, log_times_ns: Integers) -> Integers:
    """Find where the numbering began again at 1 while time went on: a source started again.

    Parameters
    ----------
    sequences, log_times_ns : ndarray of int, (messages,)
        Sequence numbers and instants of sending, in the order of sending.

    Returns
    -------
    ndarray of int, (restarts,)
        Index of the first message of each new run.
    """
    begins = (sequences[1:] == 1) & (sequences[:-1] > 1) & (np.diff(log_times_ns) > 0)
    return np.flatnonzero(begins) + 1


def taking_turns(sequences: Integers) -> Integers:
    """Find where the numbers of two sources on one topic take turns.

    Parameters
    ----------
    sequences : ndarray of int, (messages,)
        Numbers in the order of sending.

    Returns
    -------
    ndarray of int, (turns,)
        Index of each message whose number is not above the one before it, but follows one of those
        that were sent shortly before; nothing where a few places or other faults explain it.
    """
    backward = np.flatnonzero(np.diff(sequences) < 1) + 1
    if len(backward) < _TURNS:
        return np.empty(0, np.int64)
    earlier = backward[:, np.newaxis] - np.arange(2, 2 + _NEAR)
    follows = sequences[backward, np.newaxis] - 1 == sequences[np.maximum(earlier, 0)]
    turns = backward[(follows & (earlier >= 0)).any(axis=1)]
    return turns if len(turns) >= _MOSTLY * len(backward) else np.empty(0, np.int64)


def number_gaps(sequences: Integers, type_name: str) -> str:
    """Return in words how many numbers are left out, and where first; empty where none is.

    Parameters
    ----------
    sequences : ndarray of int, (messages,)
        Numbers in the order of sending.
    type_name : str
        Type of the messages: it gives the meaning of a number that is left out.
    """
    steps = np.diff(sequences)
    gaps = np.flatnonzero(steps > 1)
    if not len(gaps):
        return ""
    text = missing_text(int(np.sum(steps[gaps] - 1)), type_name, len(gaps))
    return f"{text}, the first after number {sequences[gaps[0]]}"


def number_problems(sequences: Integers, type_name: str) -> list[str]:
    """Return gaps of sequence numbers, and places where they do not go up, one line each.

    Parameters
    ----------
    sequences, type_name
        As for `number_gaps`.
    """
    gaps, backward = number_gaps(sequences, type_name), np.flatnonzero(np.diff(sequences) < 1)
    problems = [gaps] if gaps else []
    if len(backward):
        at = backward[0]
        problems.append(
            f"the numbering does not go up at {counted(len(backward), 'place')}, the first after"
            f" number {sequences[at]}, where {sequences[at + 1]} follows"
        )
    return problems


def clock_problems(sequences: Integers, stamps_ns: Integers, log_times_ns: Integers) -> list[str]:
    """Return what is wrong with the instants of sampling and of sending, one line each.

    It finds stamps or times that do not advance, periods without a sample although the numbers
    follow each other, and a clock that was set while recording.

    Parameters
    ----------
    sequences, stamps_ns, log_times_ns : ndarray of int, (messages,)
        Sequence numbers, instants of sampling, and instants of sending.
    """
    following = np.diff(sequences) == 1
    steps_ns, log_steps_ns = np.diff(stamps_ns), np.diff(log_times_ns)
    problems = []
    for name, steps in (("the stamps do", steps_ns), ("the clock does", log_steps_ns)):
        # Two messages may be sent at one instant, but not sampled.
        standing = np.flatnonzero(following & (steps < (name == "the stamps do")))
        if len(standing):
            problems.append(
                f"{name} not advance at {counted(len(standing), 'place')}, the first after"
                f" number {sequences[standing[0]]}"
            )
    if not np.any(following & (steps_ns > 0)):
        return problems
    period_ns = float(np.median(steps_ns[following & (steps_ns > 0)]))
    problems += _skipped(sequences, stamps_ns, period_ns)
    log_period_ns = float(np.median(log_steps_ns[following]))
    jumps_ns = np.where(following, log_steps_ns - steps_ns, 0)
    if np.ptp(steps_ns[following]) <= _ROUNDING_NS:
        # In virtual time the arm's time stands still when the machine stalls or nobody answers.
        jumps_ns = np.minimum(jumps_ns, 0)
    at = int(np.argmax(np.abs(jumps_ns)))
    is_real_time = abs(log_period_ns - period_ns) <= _REAL_TIME * period_ns
    if is_real_time and abs(jumps_ns[at]) > _CLOCK_STEP_NS:
        problems.append(
            f"the clock was set by {jumps_ns[at] / _NS:+.3f} s after number {sequences[at]}"
        )
    return problems


def _skipped(sequences: Integers, stamps_ns: Integers, period_ns: float) -> list[str]:
    """Find periods without a sample that the numbers do not show."""
    found: list[tuple[int, int, int]] = []
    for run in np.split(np.arange(len(sequences)), np.flatnonzero(np.diff(sequences) < 1) + 1):
        stamps = stamps_ns[run]
        advances = np.diff(np.maximum.accumulate(stamps), prepend=stamps[0] - 1) > 0
        found += _left_out(sequences[run][advances], stamps[advances], period_ns)
    if not found:
        return []
    missing, places, first = zip(*found, strict=True)
    problem = (
        f"{counted(sum(missing), 'period')} of {period_ns / 1e6:.3f} ms without a sample at"
        f" {counted(sum(places), 'place')}, the first after number {first[0]}"
    )
    return [problem]


def _left_out(
    sequences: Integers, stamps_ns: Integers, period_ns: float
) -> list[tuple[int, int, int]]:
    """Return periods left out, their number of places, and the number before the first.

    The lateness of a sample refers to the instant of its number. It lasts when periods were left
    out before the sample. The lasting part is the lateness of the earliest of the next samples.
    """
    late = (stamps_ns - stamps_ns[0]) / period_ns - (sequences - sequences[0])
    rises = np.diff(_least_of_the_next(late))
    steps = np.flatnonzero(np.abs(rises) > _STEP)
    # Steps that stand together are judged together: down and up again is only jitter.
    apart = np.flatnonzero(np.diff(steps) > 2 * _SOON) + 1
    found = []
    for group in np.split(steps, apart) if len(steps) else ():
        missing = int(np.floor(rises[group[0] : group[-1] + 1].sum() + _EARLY))
        if missing > 0:
            long = group[rises[group] > 1.0 - _EARLY]
            found.append((missing, max(len(long), 1), int(sequences[group[0]])))
    return found


def _least_of_the_next(late: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least of each value and those that follow it soon."""
    padded = np.concatenate((late, np.full(_SOON - 1, np.inf)))
    least: NDArray[np.float64] = np.lib.stride_tricks.sliding_window_view(padded, _SOON).min(axis=1)
    return least
