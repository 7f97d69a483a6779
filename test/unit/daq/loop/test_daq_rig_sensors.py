"""Sensor check of rigs that are not the thesis's arm."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_core.rig_description import described
from flexarm_daq.loop.sensor_check import SensorCheck, SensorLimits

if TYPE_CHECKING:
    from flexarm_core.rig_description import RigDescription

RATE_HZ = 200.0
RIG = described(
    """
name: two
rate_hz: 200
inputs:
  first: {quantity: torque, unit: N m, limits: 3}
  second: {quantity: force, unit: N, limits: 3}
outputs:
  cart_mm: {quantity: position, unit: mm}
  hub_deg: {quantity: angle, unit: deg, range: [-180, 180], wrap: 360}
  hub_rpm: {quantity: rate, unit: rpm}
  cart_mm_per_s: {quantity: velocity, unit: mm/s}
  pole_deg: {quantity: angle, unit: deg, range: [0, 360], wrap: 360}
  force: {quantity: force, unit: N, range: [10, 20]}
  free: {unit: x}
  none: {unit: x, range: 1, absent: true}
joints:
  cart: {input: second, angle: cart_mm, rate: cart_mm_per_s, travel: [-100, 300]}
  hub: {input: first, angle: hub_deg, rate: hub_rpm, travel: [200, 600]}
driver: rig.py:Mine
"""
)
REST = {"hub_deg": 400.0, "pole_deg": 90.0, "force": 15.0}


def complaints(
    samples: int,
    stuck_samples: int = 0,
    absent: tuple[str, ...] = (),
    rig: RigDescription = RIG,
    **courses: float | np.ndarray,
) -> list[tuple[int, str]]:
    """Return the samples with a complaint, for courses of some outputs beside the others' rest."""
    check = SensorCheck(RATE_HZ, SensorLimits(stuck_samples=stuck_samples), absent, rig)
    columns = [
        np.broadcast_to(courses.get(name, REST.get(name, 0.0)), samples)
        for name in RIG.output_names
    ]
    rows = np.column_stack(columns)
    found = [(k, check.complaint(k / RATE_HZ, row)) for k, row in enumerate(rows)]
    return [each for each in found if each[1]]


def test_rig___at_rest___has_no_complaint() -> None:
    assert complaints(300) == []


@pytest.mark.parametrize(
    ("name", "inside", "beyond"),
    [
        # The stops give by a twentieth of the whole travel.
        ("cart_mm", 319.0, 321.0),
        ("cart_mm", -119.0, -121.0),
        ("hub_deg", 619.0, 621.0),
        ("hub_deg", 181.0, 179.0),
    ],
)
def test_joint___beyond_its_stops___is_found_at_once(
    name: str, inside: float, beyond: float
) -> None:
    within: dict[str, Any] = {name: inside}
    outside: dict[str, Any] = {name: beyond}
    assert complaints(100, **within) == []
    found = complaints(100, **outside)
    assert found[0][0] == SensorLimits().travel_samples - 1
    assert found[0][1].startswith(f"{name} is beyond the stops at {beyond:.3f}")


@pytest.mark.parametrize(("inside", "end"), [(10.01, 10.0), (19.99, 20.0)])
def test_output___at_an_end_of_an_uneven_range___is_found_after_its_time(
    inside: float, end: float
) -> None:
    assert complaints(300, force=inside) == []
    after = math.ceil(SensorLimits().gauge_saturated_s * RATE_HZ)
    assert complaints(after - 1, force=end) == []
    found = complaints(after, force=end)
    assert found == [
        (after - 1, f"force is at the end of its range at {end:.3f} N: saturated or open")
    ]


@pytest.mark.parametrize("level", [0.0, 360.0, 1000.0, -1000.0])
def test_encoder___that_begins_anew___has_no_end_of_its_range(level: float) -> None:
    """A pendulum that hangs at zero, or has turned over."""
    assert complaints(300, pole_deg=level) == []


def test_output___without_a_range___may_be_anywhere() -> None:
    assert complaints(300, free=1e12) == []


def test_absent_output___at_its_end___need_only_be_a_number() -> None:
    assert complaints(300, none=1.0) == []
    assert complaints(1, none=math.nan) == [(0, "none is not a number")]


@pytest.mark.parametrize("name", ["pole_deg", "hub_deg"])
def test_encoder___that_stands_beyond_its_range___is_stuck_too(name: str) -> None:
    noise: dict[str, Any] = {
        each: REST.get(each, 0.0) + 1e-3 * np.random.default_rng(1).standard_normal(100)
        for each in RIG.output_names
        if each not in (name, "hub_rpm")
    }
    found = complaints(100, 30, ("hub_rpm",), **(noise | {name: np.full(100, 500.0)}))
    assert found[0] == (
        29,
        f"{name} is stuck at 500.000 deg: 30 equal readings, as stuck_samples has it",
    )


def test_angle_and_rate___of_the_second_joint___are_compared_in_si() -> None:
    time_s = np.arange(300) / RATE_HZ
    # 10 rpm are 60 degrees a second.
    turning: dict[str, Any] = {"hub_deg": 300.0 + 60.0 * time_s, "hub_rpm": 10.0}
    assert complaints(300, **turning) == []
    found = complaints(300, **(turning | {"hub_rpm": -10.0}))
    assert "hub_deg and hub_rpm disagree by 25 degrees" in found[0][1]
    assert complaints(300, absent=("hub_rpm",), **(turning | {"hub_rpm": -10.0})) == []


def test_angle_and_rate___of_each_of_two_joints___are_compared_by_themselves() -> None:
    text = RIG.text.replace("quantity: position, unit: mm", "quantity: angle, unit: deg")
    rig = described(text.replace("quantity: velocity, unit: mm/s", "quantity: rate, unit: rpm"))
    turning = 300.0 + 60.0 * np.arange(300) / RATE_HZ
    found = complaints(300, rig=rig, hub_deg=turning, hub_rpm=-10.0)
    assert "hub_deg and hub_rpm disagree by 25 degrees" in found[0][1]
    assert complaints(300, rig=rig, hub_deg=turning, hub_rpm=10.0) == []


def test_position_and_velocity___of_a_joint_that_slides___are_not_compared() -> None:
    assert complaints(300, cart_mm_per_s=1e5) == []
