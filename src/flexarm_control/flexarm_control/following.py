"""Trajectory of an action in the loop: its set-points, and how it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.planning.joint_trajectory import Moment

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_control.planning.joint_trajectory import JointTrajectory
    from flexarm_core.arrays import FloatArray


class Tolerances(NamedTuple):
    """What the joints must keep to, in rows of rad and rad/s, (2, joints), infinite for anything.

    `goal_s` is the time after the end of the trajectory to reach the goal, s; infinite for any.
    """

    path: FloatArray
    goal: FloatArray
    goal_s: float


class Feedback(NamedTuple):
    """What a sample has shown: its stamp, ns, what is wanted, and where the joints are.

    Velocities that are not measured are not numbers.
    """

    taken_ns: int
    desired: Moment
    actual: Moment

    @property
    def error(self) -> Moment:
        """Errors of the joints, rad and rad/s."""
        return Moment(
            self.desired.positions - self.actual.positions,
            self.desired.velocities - self.actual.velocities,
        )


class Following:
    """Trajectory that the joints follow from the next sample on.

    The thread of the loop asks for the set-points; the executor reads `feedback` and `ended`.

    Parameters
    ----------
    trajectory : JointTrajectory
        The trajectory, rad.
    tolerances : Tolerances
        What its joints must keep to.
    measured : callable
        Function that returns the joints for the outputs of a sample.
    per_rad : ndarray, (joints,)
        Units of the set-points in a radian.

    Attributes
    ----------
    feedback : Feedback or None
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
        measured: Callable[[Sequence[float]], Moment],
        per_rad: FloatArray,
    ) -> None:
        self._trajectory, self._tolerances = trajectory, tolerances
        self._measured, self._per_rad = measured, per_rad
        self._start_ns: int | None = None
        self.feedback: Feedback | None = None
        self.ended: str | None = None

    def references(self, taken_ns: int, outputs: Sequence[float]) -> tuple[float, ...]:
        """Return the set-points at a sample; where the trajectory has ended, they stay."""
        if self._start_ns is None:
            self._start_ns = taken_ns
        time_s = 1e-9 * (taken_ns - self._start_ns)
        if self.ended is None or self.feedback is None:
            self.feedback = Feedback(taken_ns, self._trajectory.at(time_s), self._measured(outputs))
            self.ended = self._ending(time_s, np.abs(self.feedback.error))
        return tuple((self.feedback.desired.positions * self._per_rad).tolist())

    def _ending(self, time_s: float, errors: FloatArray) -> str | None:
        late_s = time_s - self._trajectory.end_s
        if late_s < 0.0:
            return self.PATH if (errors > self._tolerances.path).any() else None
        if not (errors > self._tolerances.goal).any():
            return ""
        return self.GOAL if late_s > self._tolerances.goal_s else None
