"""Trajectory of the arm that is known in advance, and the law that plays its command.

A reference of steps or of any other shape is spread by the unit move of the flat model: each of its
changes is a move of that shape, and all moves add up, since the model is linear. The move is the
shortest one that keeps the command within its peak.

The model is flat [1]_: command and outputs are sums of derivatives of one signal z, which at rest
is the position. A move of z between two points of rest, smooth enough, is one of the whole arm::

    u  = (z'''' + (2 zeta w + d) z''' + (w^2 + 2 zeta w d) z'' + w^2 d z') / (g w^2)
    y1 = z + ((2 zeta w + rho d) z' + (1 + rho) z'') / w^2
    y3 = mu (z'' + d z'),    y4 = tau y1'

It lasts longer than a move of `flexarm_control.planning`, and has nothing above the frequencies
that a repetition learns.

References
----------
.. [1] Fliess, M., Levine, J., Martin, P., and Rouchon, P. (1995). Flatness and defect of non-linear
   systems: introductory theory and examples. International Journal of Control 61(6), 1327-1361.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, replace
from math import ceil, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, hearing, limited
from flexarm_control.planning.flat_arm import SPEED_PER_POSITION_S
from flexarm_core.channels import TRAVEL_V
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import LawWithMemory, Memory
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
_ORDER = 4
"""Derivatives of z that vanish at both ends: the order of the model."""
_STILL_V = 1e-3
"""Speed of a trajectory that stands still, V: below the step of the converter."""


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


def progress(share: FloatArray) -> FloatArray:
    """Return a move of one from 0 to 1 and its derivatives up to the fourth, (5, points).

    All four derivatives vanish at both ends. The move is the integral of a multiple of x^4 (1-x)^4.
    """
    return np.asarray(polyval(share, _PROGRESS), dtype=np.float64)


def _progress() -> FloatArray:
    """Return the coefficients of the move and its derivatives, one column each."""
    x = Polynomial([0.0, 1.0])
    rise = (x**_ORDER * (1.0 - x) ** _ORDER).integ()
    columns = [(rise / rise(1.0)).deriv(order).coef for order in range(_ORDER + 1)]
    return np.column_stack([np.pad(each, (0, len(rise.coef) - len(each))) for each in columns])


_PROGRESS: FloatArray = _progress()


def command_weights(arm: FlatArm) -> FloatArray:
    """Return the weights of z', z'', z''' and z'''' in the command, (4,)."""
    w, drag = 2.0 * pi * arm.frequency_hz, arm.drag_per_s
    decay = 2.0 * arm.damping_ratio * w
    weights = np.array([w**2 * drag, w**2 + decay * drag, decay + drag, 1.0])
    return weights / (arm.gain_per_s2 * w**2)


def output_weights(arm: FlatArm) -> FloatArray:
    """Return the weights of z to z''' in position, middle gauge and speed, (3, 4)."""
    w = 2.0 * pi * arm.frequency_hz
    first = (2.0 * arm.damping_ratio * w + arm.hub_share * arm.drag_per_s) / w**2
    second = (1.0 + arm.hub_share) / w**2
    bend, tau = arm.middle_strain_s2, SPEED_PER_POSITION_S
    return np.array(
        [
            [1.0, first, second, 0.0],
            [0.0, bend * arm.drag_per_s, bend, 0.0],
            [0.0, tau, tau * first, tau * second],
        ]
    )


def unit_move(arm: FlatArm, samples: int, rate_hz: float) -> FloatArray:
    """Return position, middle gauge, speed and command of a move of 1 V, (4, samples).

    A command is held over its period, so it is that of the middle of the period.

    Parameters
    ----------
    arm : FlatArm
        Arm.
    samples : int
        Length of the move.
    rate_hz : float
        Sampling rate, Hz.
    """
    at = np.arange(samples) / samples
    scale = (samples / rate_hz) ** -np.arange(_ORDER + 1.0)[:, None]
    outputs = output_weights(arm) @ (scale * progress(at))[:_ORDER]
    held = scale * progress(at + 0.5 / samples)
    return np.vstack([outputs, command_weights(arm) @ held[1:]])


class FollowingLaw:
    """Law that follows a trajectory once, and holds its end.

    The law in it gets the differences to the outputs that are asked for, as if the arm stood at the
    end. While the trajectory moves, the compensation of friction follows its speed, which has no
    noise; the law's own is that of the rest.

    Parameters
    ----------
    law : LawWithMemory
        Law of a PDP loop.
    trajectory : Trajectory
        Trajectory, and the command that is played.
    compensation_v, full_speed_v : float
        Level of the compensation of friction, and speed from which it is full, V.

    Attributes
    ----------
    rate_hz : float
        Sampling rate, Hz.
    """

    def __init__(
        self,
        law: LawWithMemory,
        trajectory: Trajectory,
        *,
        compensation_v: float,
        full_speed_v: float,
    ) -> None:
        self.rate_hz = trajectory.rate_hz
        self._law = law
        self.hear = hearing(law)
        self._end_v = trajectory.end_v
        next_speed_v = np.append(trajectory.speed_v[1:], 0.0)
        moves = np.abs(next_speed_v) > _STILL_V
        share = np.clip(next_speed_v / full_speed_v, -1.0, 1.0)
        columns = (
            trajectory.position_v - self._end_v,
            trajectory.middle_strain_v,
            trajectory.speed_v,
            trajectory.command_v,
            share * compensation_v,
        )
        self._rows = np.column_stack(columns).tolist()
        self._moves = moves.tolist()
        self._at = 0

    def asked_v(self, time_s: float) -> float:  # noqa: ARG002 - a reference has it
        """Return the position that is asked for at the next sample, V, whatever the time is."""
        left_v = self._rows[self._at][0] if self._at < len(self._rows) else 0.0
        return float(self._end_v + left_v)

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:  # noqa: ARG002 - it has its own
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        if self._at == len(self._rows):
            return self._law.step(volts, self._end_v)
        left_v, strain_v, speed_v, command_v, compensation_v = self._rows[self._at]
        moves = self._moves[self._at]
        self._at += 1
        differences = volts[0] - left_v, volts[1], volts[2] - strain_v, volts[3] - speed_v
        answer = self._law.step(differences, self._end_v)
        if answer is NO_EFFORT:
            return answer
        return limited(
            command_v + answer.effort_v, compensation_v if moves else answer.compensation_v
        )

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._law.reset()
        self._at = 0

    def memory(self) -> Memory:
        """Return the place in the trajectory, and the memory of the law."""
        return {"played": (float(self._at),), **self._law.memory()}

    def remember(self, memory: Memory) -> None:
        """Go on from a place and a memory of the law; see `LawWithMemory.remember`."""
        self._at = int(memory["played"][0])
        self._law.remember(memory)
