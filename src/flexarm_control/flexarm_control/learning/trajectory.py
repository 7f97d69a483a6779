"""Trajectory of the arm that is known in advance, and the command that is played for it.

A reference of steps or of any other shape is spread by the unit move of the flat model
(`flexarm_control.learning.smooth_move`): each of its changes is a move of that shape, and all moves
add up, since the model is linear. The move is the shortest one that keeps the command within its
peak.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, replace
from math import ceil, pi
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.learning.smooth_move import unit_move
from flexarm_core.channels import TRAVEL_V
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_core.arrays import FloatArray

_POSITION, _COMMAND = 0, 3
_REST_S = 1.0
_SHORTEST_S, _LONGEST_S = 0.25, 10.0
"""Shortest and longest move of a change."""
_HIGHER_MODES = 0.117
"""Position by the bending of the higher modes, over the middle gauge with its sign turned.

Fitted to the simulated rig without friction; 0.115 to 0.122 with 0 to 400 g.
"""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Signals of the arm that are asked for, sample by sample, and the command that is played.

    Attributes
    ----------
    rate_hz : float
        Sampling rate, Hz.
    position_v, middle_strain_v, speed_v : ndarray, (samples,)
        Outputs that are asked for, V. The arm is at rest before the first sample and after the
        last.
    command_v : ndarray, (samples,)
        Command that is played, without feedback and compensation of friction, V.

    Raises
    ------
    SettingError
        When there is no sample, signals differ in length, or a number has no sense.
    """

    rate_hz: float
    position_v: FloatArray
    middle_strain_v: FloatArray
    speed_v: FloatArray
    command_v: FloatArray

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz < np.inf:
            raise SettingError(f"the trajectory's rate_hz must be positive, got {self.rate_hz}")
        for name in SIGNALS:
            values = getattr(self, name)
            if values.shape != self.position_v.shape or values.ndim != 1 or not len(values):
                raise SettingError(f"the trajectory's {name} must have a value for every sample")
            if not np.isfinite(values).all():
                raise SettingError(f"the trajectory's {name} must be finite")
        if np.abs(self.position_v).max() > TRAVEL_V:
            raise SettingError(
                f"the trajectory's position_v leaves the travel of +-{TRAVEL_V:.3f} V"
            )

    def __len__(self) -> int:
        return len(self.position_v)

    @property
    def end_v(self) -> float:
        """Position at the end, V."""
        return float(self.position_v[-1])

    def playing(self, command_v: FloatArray) -> Trajectory:
        """Return the same trajectory with another command."""
        return replace(self, command_v=command_v)


SIGNALS = ("position_v", "middle_strain_v", "speed_v", "command_v")
"""Signals of a trajectory, in the order of its files."""


def planned_trajectory(
    reference_v: FloatArray, arm: FlatArm, peak_v: float, rate_hz: float
) -> Trajectory:
    """Return the trajectory of a reference, with the command of the model.

    Parameters
    ----------
    reference_v : ndarray, (samples,)
        Reference, V. Before it the arm is at rest in the middle of the travel.
    arm : FlatArm
        Figures of the arm.
    peak_v : float
        Largest command, V.
    rate_hz : float
        Sampling rate, Hz.

    Returns
    -------
    Trajectory
        The reference spread by the move, and held for a second after the last move; it is longer
        than the reference by a move and that second.

    Raises
    ------
    SettingError
        When the reference has no sample, is not finite or leaves the travel, or needs a larger
        command however slow the move is.
    """
    if not len(reference_v) or not np.isfinite(reference_v).all():
        raise SettingError("the reference must have samples, and all must be finite")

    held_v = np.pad(reference_v, (0, round(_REST_S * rate_hz)), mode="edge")

    def signals(samples: int) -> FloatArray:
        return _spread(held_v, arm, samples, rate_hz)

    def is_within(samples: int) -> bool:
        return bool(np.abs(signals(samples)[_COMMAND]).max() <= peak_v)

    least, most = ceil(_SHORTEST_S * rate_hz), ceil(_LONGEST_S * rate_hz)
    samples = bisect_left(range(most), x=True, lo=least, key=is_within)
    if samples == most:
        raise SettingError(
            f"the reference needs a command above {peak_v:g} V even if every change takes "
            f"{_LONGEST_S:g} s: ask for less"
        )
    return Trajectory(rate_hz, *signals(samples))


def bending_hub(arm: FlatArm) -> FlatArm:
    """Return the figures with the quasi-static bending of the higher modes in the hub's share.

    The figures of the simulated rig have one mode, as a plan that a loop improves needs no more. A
    position that is learned should be one that the arm can take: without the higher modes, which
    bend with the torque, it is up to 0.17 V off in a step of 3 V while the gauge is right.
    """
    angular = 2.0 * pi * arm.frequency_hz
    bent = _HIGHER_MODES * abs(arm.middle_strain_s2) * angular**2
    return replace(arm, hub_share=arm.hub_share + bent)


def _spread(reference_v: FloatArray, arm: FlatArm, samples: int, rate_hz: float) -> FloatArray:
    """Return position, middle gauge, speed and command of the spread reference, (4, ...)."""
    # Half a second to load, which every controller would take that learns nothing.
    from scipy.signal import fftconvolve  # noqa: PLC0415

    unit = unit_move(arm, samples, rate_hz)
    # Each change is a move that stays at its end: a change of the position is what ends.
    unit[_POSITION] = np.diff(unit[_POSITION], append=1.0)
    changes_v = np.diff(reference_v, prepend=0.0)
    spread = np.array([fftconvolve(changes_v, each) for each in unit])
    spread[_POSITION] = np.concatenate([[0.0], np.cumsum(spread[_POSITION])[:-1]])
    return spread
