"""Samples and commands as they pass through the loop, of any number of inputs and outputs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription

MAX_CATCH_UP_S: Final = 1.0
"""Longest gap of real time that a simulated rig moves on by, s; the rest is left out."""


class RigSample(NamedTuple):
    """Readings of all sensors of a rig at one instant.

    Attributes
    ----------
    time_s : float
        Instant of the sample, since the rig was opened, s.
    outputs : ndarray, (outputs,)
        Readings in the order of the rig's description: for the thesis's arm the four voltages of
        `flexarm_core.channels.CHANNELS`.
    commands : tuple of float or None
        What the rig says of its drives at that instant, in the order of its inputs; None when it
        says nothing, and the last command is in force.
    """

    time_s: float
    outputs: FloatArray
    commands: tuple[float, ...] | None = None


def steps_to(now_s: float, moved_s: float, step_s: float) -> tuple[int, float]:
    """Return the whole steps of a simulated rig from where it has moved to the present.

    Parameters
    ----------
    now_s, moved_s : float
        The present, and the instant that the rig has reached, s.
    step_s : float
        Length of a step, s.

    Returns
    -------
    steps : int
        Steps, of at most `MAX_CATCH_UP_S` together.
    moved_s : float
        Instant that the rig reaches by them, s.
    """
    gap_s = now_s - moved_s
    if gap_s > MAX_CATCH_UP_S:
        gap_s, moved_s = MAX_CATCH_UP_S, now_s - MAX_CATCH_UP_S
    steps = max(0, math.floor(gap_s / step_s))
    return steps, moved_s + steps * step_s


class Sample(NamedTuple):
    """Outputs at one instant, with the command in force while they were sampled.

    Attributes
    ----------
    taken_ns : int
        Instant, nanoseconds since the epoch.
    sequence : int
        Number of the sampling period, from 1.
    outputs : tuple of float
        Readings, in the order and the units of the rig's description.
    commands, compensations : tuple of float
        Commands of the inputs behind all limits, and the part of each that compensates friction.
    command_sequence : int
        Number of the command in force; 0 for none.
    """

    taken_ns: int
    sequence: int
    outputs: tuple[float, ...]
    commands: tuple[float, ...]
    compensations: tuple[float, ...]
    command_sequence: int


class Command(NamedTuple):
    """Request of a controller in answer to one sample.

    Attributes
    ----------
    sequence, state_sequence : int
        Number of the command, and of the sample that it answers.
    efforts, compensations : tuple of float
        Feedback efforts u_e and friction compensations u_c (4-6) of the inputs; each drive gets
        their sum.
    stamp_ns : int
        Instant of the sample that it answers, nanoseconds since the epoch.
    """

    sequence: int
    state_sequence: int
    efforts: tuple[float, ...]
    compensations: tuple[float, ...]
    stamp_ns: int = 0


def require_both_ways(rig: RigDescription, who: str, advice: str) -> None:
    """Refuse a rig with a joint whose input rests at an end of its limits.

    Raises
    ------
    SettingError
        With who drives the joints, and what else to do.
    """
    for joint in rig.joints:
        driven = rig.input(joint.input)
        if not driven.reach > 0.0:
            raise SettingError(
                f"{who} joint {joint.name} both ways, and {driven.name} of rig {rig.name} rests at "
                f"{driven.rest:g} {driven.unit}, an end of its limits: give it another rest, or "
                f"{advice}"
            )
