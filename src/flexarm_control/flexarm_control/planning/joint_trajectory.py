"""Trajectory of the joints through points, run as joint_trajectory_controller of ROS 2 does."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import SettingError, nearest

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_core.arrays import FloatArray

# Instants of a segment at which it must be within the travel.
_LOOKS = 33
# Largest speed of a joint that rests, as joint_trajectory_controller has it.
_STILL_RAD_PER_S = float(np.finfo(np.float32).eps)


class Point(NamedTuple):
    """Positions of the joints, their speeds or none, and the time since the start, s."""

    time_s: float
    positions: Sequence[float]
    velocities: Sequence[float] = ()


class Moment(NamedTuple):
    """Positions and velocities of the joints, (joints,)."""

    positions: FloatArray
    velocities: FloatArray


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """Move of all joints: cubic between points with velocities, linear elsewhere.

    Attributes
    ----------
    times_s : ndarray, (points,)
        Times since the start, the first one zero, s.
    positions, velocities : ndarray, (points, joints)
        Positions and velocities, not a number where none is given.
    """

    times_s: FloatArray
    positions: FloatArray
    velocities: FloatArray

    @property
    def end_s(self) -> float:
        """Time of the last point, s."""
        return float(self.times_s[-1])

    def at(self, time_s: float) -> Moment:
        """Return the joints at a time; they rest at the last point."""
        if time_s >= self.end_s:
            return Moment(self.positions[-1], np.zeros(self.positions.shape[1]))
        i = int(np.searchsorted(self.times_s, time_s, side="right")) - 1
        length_s = self.times_s[i + 1] - self.times_s[i]
        part = (time_s - self.times_s[i]) / length_s
        start, end = self.positions[i], self.positions[i + 1]
        moved = end - start
        leaving, arriving = length_s * self.velocities[i : i + 2]
        if not np.isfinite(leaving + arriving).all():
            return Moment(start + part * moved, moved / length_s)
        # Hermite's cubic polynomial.
        second = 3.0 * moved - 2.0 * leaving - arriving
        third = leaving + arriving - 2.0 * moved
        return Moment(
            start + part * (leaving + part * (second + part * third)),
            (leaving + part * (2.0 * second + part * 3.0 * third)) / length_s,
        )


def places_of(names: Sequence[str], joints: Sequence[str]) -> list[int]:
    """Return the place of each joint among the names of a trajectory.

    Raises
    ------
    SettingError
        When the names are not those of all joints, each once.
    """
    for name in names:
        if name not in joints:
            raise SettingError(f"no joint {name!r}{nearest(name, joints)}")
    if sorted(names) != sorted(joints):
        raise SettingError(
            f"a trajectory names each joint once, {', '.join(joints)}, not {', '.join(names)}"
        )
    return [names.index(joint) for joint in joints]


def trajectory_through(
    start: Sequence[float], points: Sequence[Point], travels: Mapping[str, tuple[float, float]]
) -> JointTrajectory:
    """Return the trajectory from rest at the start through some points.

    Parameters
    ----------
    start : sequence of float
        Positions of the joints.
    points : sequence of Point
        Points in the order of time. One at zero takes the place of the start.
    travels : mapping of str to tuple of float
        Ends of the travel of each joint, by its name.

    Raises
    ------
    SettingError
        When a point has another number of values or one that is not finite, does not come after the
        one before, the joints move at the last one, or the trajectory leaves the travel of a joint.
    """
    if not points:
        raise SettingError("a trajectory needs a point")
    count = len(start)
    for number, point in enumerate(points, 1):
        if len(point.positions) != count or len(point.velocities) not in (0, count):
            raise SettingError(
                f"point {number} has {len(point.positions)} positions and "
                f"{len(point.velocities)} velocities for {count} joints"
            )
        if not np.isfinite([point.time_s, *point.positions, *point.velocities]).all():
            raise SettingError(f"point {number} has a value that is not finite")
    if points[0].time_s < 0.0:
        raise SettingError(f"point 1 is before the start, at {points[0].time_s:g} s")
    for number, (before, after) in enumerate(pairwise(points), 2):
        if after.time_s <= before.time_s:
            raise SettingError(
                f"point {number} at {after.time_s:g} s is not after point {number - 1} at "
                f"{before.time_s:g} s"
            )
    if np.any(np.abs(points[-1].velocities) > _STILL_RAD_PER_S):
        raise SettingError(
            f"the joints move at the last point, {len(points)}: its velocities are zero, or none"
        )
    first = [Point(0.0, start, [0.0] * count)] if points[0].time_s > 0.0 else []
    whole = [*first, *points]
    found = JointTrajectory(
        np.array([each.time_s for each in whole], dtype=float),
        np.array([each.positions for each in whole], dtype=float),
        np.array([each.velocities or [np.nan] * count for each in whole], dtype=float),
    )
    _require_travel(found, travels)
    return found


def _require_travel(
    trajectory: JointTrajectory, travels: Mapping[str, tuple[float, float]]
) -> None:
    names, (low, high) = list(travels), np.transpose(list(travels.values()))
    segments = [np.linspace(*ends, _LOOKS) for ends in pairwise(trajectory.times_s)]
    for time_s in np.concatenate([*segments, trajectory.times_s[-1:]]):
        positions = trajectory.at(float(time_s)).positions
        for joint in np.flatnonzero((positions < low) | (positions > high)):
            raise SettingError(
                f"{names[joint]} goes to {positions[joint]:.4g} rad at {time_s:.3g} s: its "
                f"travel is {low[joint]:.4g} to {high[joint]:.4g} rad"
            )
