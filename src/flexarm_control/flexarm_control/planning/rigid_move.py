"""Fastest moves of the arm without its bending mode: full command, then full braking.

The command is constant in phases. One that moves the arm is at most the peak, one that brakes it is
`braking` times as large. A move may begin while an earlier one is on its way: it takes over the
speed, and the command of both together keeps the limits.
"""

from __future__ import annotations

from math import copysign, exp, expm1, log1p
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from flexarm_control.planning.flat_arm import FlatArm

LONGEST_S = 10.0
"""Longest move; figures far from those of an arm may need a larger command than is wanted."""

_HALVINGS = 60


class Phase(NamedTuple):
    """Constant command, V, and how long it lasts, s."""

    lasts_s: float
    command_v: float


Phases: TypeAlias = tuple[Phase, ...]
"""Command of a move, phase by phase; it is zero after the last."""

MOST_PHASES = 3


class Limits(NamedTuple):
    """Largest command of a move, V, and that of its braking over it."""

    peak_v: float
    braking: float


def duration_s(phases: Phases) -> float:
    """Return how long the phases last together, s."""
    return sum(phase.lasts_s for phase in phases)


def what_is_left(phases: Phases, since_s: float) -> Phases:
    """Return the phases after some time."""
    left = []
    for lasts_s, command_v in phases:
        if since_s < lasts_s:
            left.append(Phase(lasts_s - since_s, command_v))
        since_s = max(0.0, since_s - lasts_s)
    return tuple(left)


def fastest(arm: FlatArm, left: Phases, height_v: float, limits: Limits) -> Phases:
    """Return the phases that end further away than those in force.

    With drag d and gain g, a command u from speed v to rest goes as far as (v + g times the
    integral of u) / d.

    Parameters
    ----------
    arm : FlatArm
        Arm.
    left : Phases
        What is left of the phases in force; none at rest.
    height_v : float
        Distance between both ends, V.
    limits : Limits
        Limits of the command. The peak is doubled until the move ends within `LONGEST_S`.
    """
    drag, gain = arm.drag_per_s, arm.gain_per_s2
    at_s = area_v_s = weighted_v_s = 0.0
    for lasts_s, command_v in left:
        area_v_s += command_v * lasts_s
        weighted_v_s += command_v * exp(drag * at_s) * expm1(drag * lasts_s) / drag
        at_s += lasts_s
    speed_v_per_s = -gain * weighted_v_s
    distance_v = (speed_v_per_s + gain * area_v_s) / drag + height_v
    found = _from_speed(arm, speed_v_per_s, distance_v, limits)
    while duration_s(found) > LONGEST_S:
        limits = limits._replace(peak_v=2.0 * limits.peak_v)
        found = _from_speed(arm, speed_v_per_s, distance_v, limits)
    return found


def _from_speed(arm: FlatArm, speed_v_per_s: float, distance_v: float, limits: Limits) -> Phases:
    """Return the phases from a speed to rest at a distance."""
    drag, peak_v_per_s2 = arm.drag_per_s, arm.gain_per_s2 * limits.peak_v

    def stop_s(speed_v_per_s: float) -> float:
        return log1p(drag * speed_v_per_s / (limits.braking * peak_v_per_s2)) / drag

    rest_s = stop_s(abs(speed_v_per_s))
    stop_v = (abs(speed_v_per_s) - limits.braking * peak_v_per_s2 * rest_s) / drag
    beyond_v = distance_v - copysign(stop_v, speed_v_per_s)
    sign = copysign(1.0, beyond_v)
    speed_v_per_s, distance_v = sign * speed_v_per_s, sign * distance_v
    phases = []
    if speed_v_per_s < 0.0:
        phases.append(Phase(rest_s, sign * limits.braking * limits.peak_v))
        speed_v_per_s, distance_v = 0.0, sign * beyond_v

    def ends(moving_s: float) -> tuple[float, float]:
        """Return the time of the braking and the distance."""
        slower = -expm1(-drag * moving_s)
        fast_v_per_s = speed_v_per_s + slower * (peak_v_per_s2 / drag - speed_v_per_s)
        braking_s = stop_s(fast_v_per_s)
        gained_v_per_s = peak_v_per_s2 * (moving_s - limits.braking * braking_s)
        return braking_s, (speed_v_per_s + gained_v_per_s) / drag

    low_s, high_s = 0.0, 0.1
    while ends(high_s)[1] < distance_v:
        high_s *= 2.0
    for _ in range(_HALVINGS):
        middle_s = 0.5 * (low_s + high_s)
        if ends(middle_s)[1] < distance_v:
            low_s = middle_s
        else:
            high_s = middle_s
    phases.append(Phase(high_s, sign * limits.peak_v))
    phases.append(Phase(ends(high_s)[0], -sign * limits.braking * limits.peak_v))
    return tuple(phases)
