"""Trajectories through points against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_control.planning.joint_trajectory import Point, places_of, trajectory_through
from flexarm_core.errors import SettingError

TRAVELS = {"shoulder": (-1.0, 1.0), "elbow": (-2.0, 2.0)}


def test_trajectory___points_without_velocities___is_linear() -> None:
    found = trajectory_through(
        [0.2, 0.0], [Point(1.0, [0.6, -1.0]), Point(3.0, [0.0, 1.0])], TRAVELS
    )

    for time_s, positions, velocities in (
        (0.0, [0.2, 0.0], [0.4, -1.0]),
        (0.25, [0.3, -0.25], [0.4, -1.0]),
        (2.0, [0.3, 0.0], [-0.3, 1.0]),
        (3.0, [0.0, 1.0], [0.0, 0.0]),
        (9.0, [0.0, 1.0], [0.0, 0.0]),
    ):
        moment = found.at(time_s)
        np.testing.assert_allclose(moment.positions, positions, atol=1e-12)
        np.testing.assert_allclose(moment.velocities, velocities, atol=1e-12)


def test_trajectory___points_of_a_cubic___is_that_cubic() -> None:
    # From rest at zero, as the start is, to rest at 2 s.
    cubic, slope = np.poly1d([0.05, -0.15, 0.0, 0.0]), np.poly1d([0.15, -0.3, 0.0])
    points = [Point(t, [cubic(t), -cubic(t)], [slope(t), -slope(t)]) for t in (0.5, 1.0, 2.0)]
    found = trajectory_through([0.0, 0.0], points, TRAVELS)

    for time_s in np.linspace(0.0, 1.99, 50):
        moment = found.at(time_s)
        np.testing.assert_allclose(moment.positions[0], cubic(time_s), atol=1e-12)
        np.testing.assert_allclose(moment.velocities[1], -slope(time_s), atol=1e-12)


def test_trajectory___point_at_zero___takes_the_place_of_the_start() -> None:
    found = trajectory_through(
        [0.5, 0.5], [Point(0.0, [0.1, 0.2]), Point(1.0, [0.2, 0.2])], TRAVELS
    )

    np.testing.assert_allclose(found.at(0.5).positions, [0.15, 0.2])


def test_trajectory___single_point_at_zero___is_a_set_point_of_its_own() -> None:
    found = trajectory_through([0.5, 0.5], [Point(0.0, [0.1, 0.2])], TRAVELS)

    np.testing.assert_allclose(found.at(0.0).positions, [0.1, 0.2])
    assert found.end_s == 0.0


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([], "needs a point"),
        ([Point(1.0, [0.1])], "point 1 has 1 positions and 0 velocities for 2 joints"),
        ([Point(1.0, [0.1, np.nan])], "point 1 has a value that is not finite"),
        ([Point(-1.0, [0.0, 0.0])], "point 1 is before the start, at -1 s"),
        (
            [Point(1.0, [0.0, 0.0]), Point(1.0, [0.1, 0.0])],
            "point 2 at 1 s is not after point 1 at 1 s",
        ),
        ([Point(0.0, [0.0, -2.5])], "elbow goes to -2.5 rad at 0 s"),
        ([Point(1.0, [0.5, 0.0], [0.1, 0.0])], "move at the last point, 1:"),
        ([Point(1.0, [0.0, -2.5])], "elbow goes to -2.03.* its travel is -2 to 2 rad"),
        # Both ends are within the travel, and the cubic between them is not.
        (
            [Point(0.0, [0.9, 0.0], [2.0, 0.0]), Point(1.0, [0.9, 0.0], [0.0, 0.0])],
            "shoulder goes to 1.0",
        ),
    ],
)
def test_trajectory___that_cannot_be_run___is_refused(points: list[Point], said: str) -> None:
    with pytest.raises(SettingError, match=said):
        trajectory_through([0.0, 0.0], points, TRAVELS)


def test_places___in_another_order___are_found() -> None:
    assert places_of(["elbow", "shoulder"], ["shoulder", "elbow"]) == [1, 0]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["shoulder", "elbwo"], "no joint 'elbwo'.*elbow"),
        (["shoulder"], "names each joint once, shoulder, elbow, not shoulder"),
        (["shoulder", "shoulder"], "names each joint once"),
    ],
)
def test_places___of_other_joints___are_refused(names: list[str], said: str) -> None:
    with pytest.raises(SettingError, match=said):
        places_of(names, ["shoulder", "elbow"])
