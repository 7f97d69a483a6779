"""Set-points of a trajectory in the loop, and how it ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control.following import Following, Tolerances
from flexarm_control.planning.joint_trajectory import Moment, Point, trajectory_through

if TYPE_CHECKING:
    from collections.abc import Sequence

PER_RAD = 4.0
START_NS = 5_000_000_000


def following(
    *,
    path_rad: float = np.inf,
    path_rad_per_s: float = np.inf,
    goal_rad: float = np.inf,
    goal_rad_per_s: float = np.inf,
    goal_s: float = np.inf,
) -> Following:
    """Return a trajectory of the second output, whose rate is the third, to 0.5 rad in 2 s."""
    trajectory = trajectory_through([0.0], [Point(2.0, [0.5])], {"hub": (-1.0, 1.0)})
    tolerances = Tolerances(
        np.array([[path_rad], [path_rad_per_s]]), np.array([[goal_rad], [goal_rad_per_s]]), goal_s
    )

    def measured(outputs: Sequence[float]) -> Moment:
        return Moment(np.array([outputs[1]]) / PER_RAD, np.array([outputs[2]]))

    return Following(trajectory, tolerances, measured, np.array([PER_RAD]))


def reference(
    followed: Following, time_s: float, angle_rad: float, rate: float = math.nan
) -> float:
    """Return the set-point at a time, in rad."""
    outputs = [7.0, PER_RAD * angle_rad, rate]
    (value,) = followed.references(START_NS + round(1e9 * time_s), outputs)
    return value / PER_RAD


def test_following___begins_at_its_first_sample_and_ends_at_the_goal() -> None:
    followed = following()
    for time_s in (0.0, 0.5, 1.5):
        assert reference(followed, time_s, 0.0) == pytest.approx(0.25 * time_s)
        assert followed.ended is None
    assert followed.feedback is not None
    np.testing.assert_allclose(followed.feedback.error.positions, [0.375])
    assert reference(followed, 2.1, 0.0) == pytest.approx(0.5)
    assert followed.ended == ""


def test_following___beyond_the_tolerance_of_the_path___stays_where_it_is() -> None:
    followed = following(path_rad=0.1)
    reference(followed, 0.0, 0.05)
    assert followed.ended is None
    assert reference(followed, 1.0, 0.1) == pytest.approx(0.25)
    assert followed.ended == Following.PATH
    assert reference(followed, 1.5, 0.2) == pytest.approx(0.25)


def test_following___late_at_the_goal___is_waited_for_as_long_as_allowed() -> None:
    followed = following(goal_rad=0.01, goal_s=1.0)
    for time_s in (0.0, 2.0, 2.9):
        reference(followed, time_s, 0.4)
        assert followed.ended is None
    reference(followed, 2.95, 0.495)
    assert followed.ended == ""

    late = following(goal_rad=0.01, goal_s=1.0)
    reference(late, 0.0, 0.0)
    reference(late, 3.1, 0.4)
    assert late.ended == Following.GOAL


def test_following___without_a_time_for_the_goal___waits_for_ever() -> None:
    followed = following(goal_rad=0.01)
    for time_s in (0.0, 2.0, 1e5):
        reference(followed, time_s, 0.4)
        assert followed.ended is None
    reference(followed, 1e5 + 1.0, 0.5)
    assert followed.ended == ""


def test_following___of_a_measured_rate___keeps_to_the_tolerances_of_velocities() -> None:
    # The trajectory moves at 0.25 rad/s, and rests at its end.
    for rate, ended in ((0.2, None), (0.1, Following.PATH), (math.nan, None)):
        followed = following(path_rad_per_s=0.1)
        reference(followed, 0.0, 0.0, 0.25)
        reference(followed, 1.0, 0.25, rate)
        assert followed.ended == ended
    followed = following(goal_rad_per_s=0.01, goal_s=1.0)
    reference(followed, 0.0, 0.0, 0.0)
    reference(followed, 2.0, 0.5, 0.25)
    assert followed.ended is None
    reference(followed, 2.5, 0.5, 0.005)
    assert followed.ended == ""
