"""Moves of the flat model that end at rest: a rigid move, smoothed until nothing swings.

The command of a rigid move is smoothed over one period of the mode, by a window that lets no motion
of the mode's frequency and damping pass [1]_, and over a part of a period more, for the modes
above. A window raises no peak, and changes neither where the move ends nor its speed there. What
sampling leaves is taken out by the smallest change of the command that ends at rest exactly.

That command is constant in phases. One that moves the arm is at most the peak, one that brakes it
is `braking` times as large. A move may begin while an earlier one is on its way: it takes over the
speed, and the command of both together keeps the limits.

References
----------
.. [1] Singhose, W., and Seering, W. (1990). Preshaping command inputs to reduce system vibration.
   Journal of Dynamic Systems, Measurement, and Control 112(1), 76-82.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, copysign, exp, expm1, log1p
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from flexarm_control.planning.flat_arm import SPEED_PER_POSITION_S
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_core.arrays import FloatArray

_SECOND_WINDOW = 0.1
"""Length of the second window in periods of the mode."""
_POINTS = 8
"""Points at which it takes the mean of the first one."""
_LEAST_PER_S = 1e-6
"""Decay of a mode without damping, which keeps the quotient."""
LONGEST_S = 10.0
"""Longest move; figures far from those of an arm may need a larger command than is wanted."""

_HALVINGS = 60


class Planned(NamedTuple):
    """Plan at one sample.

    Attributes
    ----------
    command_v : float
        Command from this sample to the next one, V.
    left_v : float
        Position less the end of the move, V.
    middle_strain_v, speed_v : float
        Signals of the middle gauge and the tachometer, V.
    next_speed_v : float
        Tachometer signal at the next sample, V.
    """

    command_v: float
    left_v: float
    middle_strain_v: float
    speed_v: float
    next_speed_v: float


Move: TypeAlias = tuple[Planned, ...]
"""Plan of a move, sample by sample; it is over after the last."""


@dataclass(frozen=True)
class MoveSettings(Bounded):
    """Peak and first payload of the plans, and speed of the full compensation."""

    peak_v: float = setting(6.0, 0.2, 9.0, "V", "largest command of a plan, without compensation")
    payload_kg: float = setting(0.0, 0.0, 1.0, "kg", "payload of the plans until one is detected")
    full_speed_v: float = setting(0.06, 0.001, 5.0, "V", "planned speed of the full compensation")


def plan(arm: FlatArm, height_v: float, phases: Phases, instead_of: Phases, rate_hz: float) -> Move:
    """Plan a move over a distance.

    Parameters
    ----------
    arm : FlatArm
        Arm.
    height_v : float
        Distance, V.
    phases, instead_of : Phases
        Rigid move, and what is left of the one that it takes the place of. That one is played on:
        the plan is the difference.
    rate_hz : float
        Sampling rate, Hz.
    """
    lasts_s = max(duration_s(phases), duration_s(instead_of)) + sum(_windows_s(arm))
    time_s = np.arange(ceil(lasts_s * rate_hz) + 1) / rate_hz
    # What a command that is held over one period moves, one period later and so on.
    moved = np.diff(arm.step_responses(time_s))
    command_v = _smoothed(arm, phases, time_s) - _smoothed(arm, instead_of, time_s)
    scales = np.linalg.norm(moved, axis=1)
    ends = moved[:, ::-1] / scales[:, None]
    missing = np.array([height_v / scales[0], 0.0, 0.0, 0.0]) - ends @ command_v
    command_v += np.linalg.lstsq(ends, missing, rcond=None)[0]
    states = np.zeros((len(moved), len(time_s)))
    for state, each in zip(states, moved, strict=True):
        state[1:] = np.convolve(command_v, each)[: len(command_v)]
    position_v, rate_v_per_s, strain_v = arm.outputs(states)
    speed_v = SPEED_PER_POSITION_S * rate_v_per_s
    columns = (command_v, position_v[:-1] - height_v, strain_v[:-1], speed_v[:-1], speed_v[1:])
    return tuple(Planned(*row) for row in np.column_stack(columns).tolist())


def _windows_s(arm: FlatArm) -> tuple[float, float]:
    """Return the lengths of the two windows."""
    return arm.damped_period_s, _SECOND_WINDOW * arm.damped_period_s


def _smoothed(arm: FlatArm, phases: Phases, time_s: FloatArray) -> FloatArray:
    """Return the smoothed command in the middle of every period."""
    first_s, second_s = _windows_s(arm)
    decay_per_s = max(arm.decay_per_s, _LEAST_PER_S)
    back_s = (np.arange(_POINTS) + 0.5) / _POINTS * second_s
    at_s = 0.5 * (time_s[1:] + time_s[:-1]) - back_s[:, None]
    command_v, before_v = np.zeros(at_s.shape), 0.0
    for lasts_s, level_v in (*phases, (0.0, 0.0)):
        risen = np.expm1(-decay_per_s * np.clip(at_s, 0.0, first_s)) / expm1(-decay_per_s * first_s)
        command_v += (level_v - before_v) * risen
        at_s, before_v = at_s - lasts_s, level_v
    return np.asarray(command_v.mean(axis=0))


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
