"""Trajectory of an action in the loop: its set-points, and how it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.planning.joint_trajectory import JointTrajectory, Moment
    from flexarm_core.arrays import FloatArray


class Tolerances(NamedTuple):
    """Largest errors of the joints, rad, infinite for any, and the time to reach the goal, s."""

    path_rad: FloatArray
    goal_rad: FloatArray
    goal_s: float


class Told(NamedTuple):
    """What a sample has told: its stamp, ns, what is wanted, and where the joints are, rad."""

    taken_ns: int
    desired: Moment
    actual_rad: FloatArray

    @property
    def error_rad(self) -> FloatArray:
        """Errors of the joints, rad."""
        return self.desired.positions - self.actual_rad


class Following:
    """Trajectory that the joints follow from the next sample on.

    The thread of the loop asks for the set-points; the executor reads `told` and `ended`.

    Parameters
    ----------
    trajectory : JointTrajectory
        The trajectory, rad.
    tolerances : Tolerances
        What its joints must keep to.
    places : sequence of int
        Place of each joint's angle among the outputs.
    per_rad : ndarray, (joints,)
        Units of the set-points in a radian.

    Attributes
    ----------
    told : Told or None
        Newest sample.
    ended : str or None
        None while it goes on, empty at the goal, or the tolerance that was violated: `PATH` or
        `GOAL`.
    """

    PATH, GOAL = "path", "goal"

    def __init__(
        self,
        trajectory: JointTrajectory,
        tolerances: Tolerances,
        places: Sequence[int],
        per_rad: FloatArray,
    ) -> None:
        self._trajectory, self._tolerances = trajectory, tolerances
        self._places, self._per_rad = list(places), per_rad
        self._start_ns: int | None = None
        self.told: Told | None = None
        self.ended: str | None = None

    def references(self, taken_ns: int, outputs: Sequence[float]) -> tuple[float, ...]:
        """Return the set-points at a sample; where the trajectory has ended, they stay."""
        if self._start_ns is None:
            self._start_ns = taken_ns
        time_s = 1e-9 * (taken_ns - self._start_ns)
        if self.ended is None or self.told is None:
            actual_rad = np.asarray(outputs)[self._places] / self._per_rad
            self.told = Told(taken_ns, self._trajectory.at(time_s), actual_rad)
            self.ended = self._ending(time_s, np.abs(self.told.error_rad))
        return tuple((self.told.desired.positions * self._per_rad).tolist())

    def _ending(self, time_s: float, errors_rad: FloatArray) -> str | None:
        late_s = time_s - self._trajectory.end_s
        if late_s < 0.0:
            return self.PATH if (errors_rad > self._tolerances.path_rad).any() else None
        if (errors_rad <= self._tolerances.goal_rad).all():
            return ""
        return self.GOAL if late_s > self._tolerances.goal_s else None
