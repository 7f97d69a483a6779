"""Law that plays a trajectory: its command is sent, and a loop takes the differences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, hearing, limited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import LawWithMemory, Memory
    from flexarm_control.learning.trajectory import Trajectory

_STILL_V = 1e-3
"""Speed of a trajectory that stands still, V: below the step of the converter."""


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
