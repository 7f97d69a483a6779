"""What the numbers and times of recorded samples say about what is missing and about the clocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Integers = NDArray[np.int64]

_NS = 1_000_000_000
# A sample is this many periods behind the one before it: another one should have been between.
_SKIPPED = 1.5
# A step of one clock against the other, from one sample to the next, that no delay explains.
_CLOCK_STEP_NS = _NS
# In virtual time the stamps run much faster than the clock that the messages are sent by.
_REAL_TIME = 0.2


def restarts(sequences: Integers, log_times_ns: Integers) -> Integers:
    """Find where the numbering began again at 1 while time went on: a source started again.

    Parameters
    ----------
    sequences, log_times_ns : (messages,)
        Sequence numbers and instants of sending, in the order of sending.

    Returns
    -------
    (restarts,)
        Index of the first message of each new run.
    """
    begins = (sequences[1:] == 1) & (sequences[:-1] > 1) & (np.diff(log_times_ns) > 0)
    return np.flatnonzero(begins) + 1


def number_problems(sequences: Integers) -> list[str]:
    """Return what is wrong with sequence numbers.

    Parameters
    ----------
    sequences : (messages,)
        In the order of sending.

    Returns
    -------
    list of str
        One line each: numbers left out, and places where the numbering did not go up.
    """
    steps = np.diff(sequences)
    gaps, backward = np.flatnonzero(steps > 1), np.flatnonzero(steps < 1)
    problems = []
    if len(gaps):
        lost = int(np.sum(steps[gaps] - 1))
        problems.append(
            f"{lost} samples missing at {len(gaps)} places, the first after number"
            f" {sequences[gaps[0]]}"
        )
    if len(backward):
        at = backward[0]
        problems.append(
            f"the numbering does not go up at {len(backward)} places, the first after number"
            f" {sequences[at]}, where {sequences[at + 1]} follows"
        )
    return problems


def clock_problems(sequences: Integers, stamps_ns: Integers, log_times_ns: Integers) -> list[str]:
    """Return what is wrong with the instants of sampling and of sending.

    Parameters
    ----------
    sequences, stamps_ns, log_times_ns : (messages,)
        Sequence numbers, instants of sampling, and instants of sending.

    Returns
    -------
    list of str
        One line each: stamps or times that do not advance, periods without a sample although the
        numbers follow each other, and a clock that was set while recording.
    """
    following = np.diff(sequences) == 1
    steps_ns, log_steps_ns = np.diff(stamps_ns), np.diff(log_times_ns)
    problems = []
    for name, steps in (("the stamps do", steps_ns), ("the clock does", log_steps_ns)):
        # Two messages may be sent at one instant, but not sampled.
        standing = np.flatnonzero(following & (steps < (name == "the stamps do")))
        if len(standing):
            problems.append(
                f"{name} not advance at {len(standing)} places, the first after number"
                f" {sequences[standing[0]]}"
            )
    if not np.any(following & (steps_ns > 0)):
        return problems
    period_ns = float(np.median(steps_ns[following & (steps_ns > 0)]))
    problems += _skipped(sequences, steps_ns, following, period_ns)
    log_period_ns = float(np.median(log_steps_ns[following]))
    jumps_ns = np.where(following, log_steps_ns - steps_ns, 0)
    at = int(np.argmax(np.abs(jumps_ns)))
    is_real_time = abs(log_period_ns - period_ns) <= _REAL_TIME * period_ns
    if is_real_time and abs(jumps_ns[at]) > _CLOCK_STEP_NS:
        problems.append(
            f"the clock was set by {jumps_ns[at] / _NS:+.3f} s after number {sequences[at]}"
        )
    return problems


def _skipped(
    sequences: Integers, steps_ns: Integers, following: NDArray[np.bool_], period_ns: float
) -> list[str]:
    """Find periods without a sample: a late one that the next makes up for does not count."""
    lost, places = 0, []
    for at in np.flatnonzero(following & (steps_ns > _SKIPPED * period_ns)):
        around = steps_ns[max(at - 1, 0) : at + 2]
        if following[max(at - 1, 0) : at + 2].all():
            missing = round(float(around.sum()) / period_ns) - len(around)
        else:
            missing = round(float(steps_ns[at]) / period_ns) - 1
        if missing > 0:
            lost += missing
            places.append(at)
    if not places:
        return []
    problem = (
        f"{lost} periods of {period_ns / 1e6:.3f} ms without a sample at {len(places)} places, the"
        f" first after number {sequences[places[0]]}"
    )
    return [problem]
