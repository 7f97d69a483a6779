"""Moves of the flat model that end at rest: a rigid move, smoothed until nothing swings.

The command of a rigid move is smoothed over one period of the mode, by a window that lets no motion
of the mode's frequency and damping pass [1]_, and over a part of a period more, for the modes
above. A window raises no peak, and changes neither where the move ends nor its speed there. What
sampling leaves is taken out by the smallest change of the command that ends at rest exactly.

References
----------
.. [1] Singhose, W., and Seering, W. (1990). Preshaping command inputs to reduce system vibration.
   Journal of Dynamic Systems, Measurement, and Control 112(1), 76-82.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, expm1
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from flexarm_control.planning.flat_arm import SPEED_PER_POSITION_S
from flexarm_control.planning.rigid_move import duration_s
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_control.planning.rigid_move import Phases
    from flexarm_core.arrays import FloatArray

_SECOND_WINDOW = 0.1
"""Length of the second window in periods of the mode."""
_POINTS = 8
"""Points at which it takes the mean of the first one."""
_LEAST_PER_S = 1e-6
"""Decay of a mode without damping, which keeps the quotient."""


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
