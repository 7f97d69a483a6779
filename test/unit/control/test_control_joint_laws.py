from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from flexarm_control.joint_laws import (
    RATE_FILTER_HZ,
    JointLaws,
    JointWay,
    compensation_v,
    joint_ways,
    require_known_outputs,
)
from flexarm_control.laws.law_protocol import Effort
from flexarm_core.channels import (
    MAX_COMMAND_V,
    POSITION_V_PER_RAD,
    SPEED_V_S_PER_RAD,
    TRAVEL_V,
)
from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described
from flexarm_core.signals import Sample

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_control.laws.registry import LawSpec

TEXT = """
name: three
rate_hz: 500
inputs:
  lamp: {unit: W, limits: [0, 40], rest: 7}
  elbow: {quantity: torque, unit: N m, limits: [1, 7], rest: 5}
  hip: {quantity: torque, unit: N m, limits: 4}
outputs:
  warmth: {unit: K}
  hip_rad: {quantity: angle, unit: rad}
  elbow_deg: {quantity: angle, unit: deg}
  elbow_rpm: {quantity: rate, unit: rpm}
joints:
  hip: {input: hip, angle: hip_rad, travel: [-1, 2]}
  elbow:
    {input: elbow, angle: elbow_deg, rate: elbow_rpm, travel: [10, 90], sign: -1, coulomb: 0.5}
driver: rig.py:Mine
"""
RIG = described(TEXT)
HIP, ELBOW = joint_ways(RIG)
SPEED_S = SPEED_V_S_PER_RAD / POSITION_V_PER_RAD


class Fixed:
    """Law with a fixed answer, and what it was told."""

    def __init__(self, effort_v: float = 0.0, compensation_v: float = 0.0) -> None:
        self.answer = Effort(effort_v, compensation_v)
        self.volts: list[tuple[float, ...]] = []
        self.references_v: list[float] = []
        self.heard: list[tuple[float, float]] = []

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        self.volts.append(tuple(volts))
        self.references_v.append(reference_v)
        return self.answer

    def hear(self, *parts: float) -> None:
        self.heard.append((parts[0], parts[1]))

    def reset(self) -> None:
        pass

    def memory(self) -> Mapping[str, Sequence[float]]:
        return {}

    def remember(self, memory: Mapping[str, Sequence[float]]) -> None:
        pass


def sample(hip_rad: float = 0.5, elbow_deg: float = 50.0, elbow_rpm: float = 0.0) -> Sample:
    outputs = (300.0, hip_rad, elbow_deg, elbow_rpm)
    return Sample(0, 1, outputs, (7.0, 5.0, 0.0), (0.0, 0.0, 0.0), 0)


def test_angles___at_the_ends_of_their_travel___are_those_of_the_thesis() -> None:
    laws = [Fixed(), Fixed()]
    loop = JointLaws(RIG, laws)
    loop.step(sample(2.0, 90.0), (-1.0, 10.0))
    hip, elbow = laws
    assert hip.volts[0][0] == pytest.approx(TRAVEL_V)
    assert elbow.volts[0][0] == pytest.approx(-TRAVEL_V)
    assert (hip.references_v[0], elbow.references_v[0]) == pytest.approx((-TRAVEL_V, TRAVEL_V))
    loop.step(sample(), (0.5, 50.0))
    assert (hip.volts[1][0], elbow.volts[1][0]) == pytest.approx((0.0, 0.0))
    assert hip.volts[1][1:3] == (0.0, 0.0)


@pytest.mark.parametrize("way", [HIP, ELBOW], ids=["hip", "elbow"])
@pytest.mark.parametrize("reference", [-3.0, 0.0, 42.0])
def test_set_point___there_and_back___is_the_same(way: JointWay, reference: float) -> None:
    assert way.reference(way.reference_v(reference)) == pytest.approx(reference)


def test_set_point_of_a_tip___is_that_of_its_joint() -> None:
    changes = {
        "  elbow_rpm:": "  tip_deg: {quantity: angle, unit: deg, range: 200}\n  elbow_rpm:",
        "driver:": "tracked: [tip_deg, elbow_deg]\ndriver:",
    }
    text = TEXT
    for old, new in changes.items():
        text = text.replace(old, new)
    laws, rig = [Fixed(), Fixed()], described(text)
    JointLaws(rig, laws).step(
        Sample(0, 1, (300.0, 0.5, 50.0, 33.0, 0.0), (7.0, 5.0, 0.0), (0.0, 0.0, 0.0), 0),
        (math.degrees(2.0), 50.0),
    )
    # The hip's angle is in rad, and 2 rad are the end of its travel.
    assert laws[0].references_v[0] == pytest.approx(TRAVEL_V)
    assert laws[0].volts[0][0] == pytest.approx(0.0)
    assert joint_ways(rig)[0].reference(TRAVEL_V) == pytest.approx(math.degrees(2.0))


@pytest.mark.parametrize("tracked", ["elbow_deg, hip_rad", "elbow_deg", "warmth, elbow_deg"])
def test_law_of_joints___set_points_of_something_else___is_refused(tracked: str) -> None:
    text = TEXT.replace("warmth: {unit: K}", "warmth: {unit: K, range: 900}")
    rig = described(text.replace("driver:", f"tracked: [{tracked}]\ndriver:"))
    spec = cast("LawSpec", SimpleNamespace(name="pd", takes_model=False, uses_outputs=(0, 3)))
    with pytest.raises(SettingError, match="or name an angle of each joint under tracked"):
        require_known_outputs(spec, rig)


def test_efforts___of_volts___move_each_input_from_its_rest() -> None:
    loop = JointLaws(RIG, [Fixed(5.0, 1.0), Fixed(-4.0, 2.0)])
    efforts, compensations = loop.step(sample(), (0.5, 50.0))
    # 10 V are 4 N m of the hip, and 2 of the elbow, whose nearer end is 7 N m.
    assert efforts == pytest.approx((7.0, 5.0 - 0.8, 2.0))
    assert compensations == pytest.approx((0.0, 0.4, 0.4))


def test_measured_rate___of_another_unit___is_that_of_the_angle() -> None:
    laws = [Fixed(), Fixed()]
    JointLaws(RIG, laws).step(sample(elbow_rpm=10.0), (0.5, 50.0))
    # 10 rpm are 60 degrees a second, and 40 degrees are the half travel; the sign is -1.
    assert laws[1].volts[0][3] == pytest.approx(-60.0 / 40.0 * TRAVEL_V * SPEED_S)


def test_rate___that_is_not_measured___is_the_filtered_change_of_the_angle() -> None:
    laws = [Fixed(), Fixed()]
    loop = JointLaws(RIG, laws)
    samples = round(10.0 * RIG.rate_hz / RATE_FILTER_HZ)
    slope_s = 0.3
    for k in range(samples):
        loop.step(sample(slope_s * k / RIG.rate_hz), (0.5, 50.0))
    rates_v = np.array([volts[3] for volts in laws[0].volts])
    whole_v = slope_s / 1.5 * TRAVEL_V * SPEED_S
    assert rates_v[0] == pytest.approx(0.0)
    assert rates_v[-1] == pytest.approx(whole_v)
    # After one time constant it has 63 % of the change.
    there = round(RIG.rate_hz / (2.0 * np.pi * RATE_FILTER_HZ))
    assert rates_v[there] == pytest.approx(0.63 * whole_v, rel=0.2)
    loop.reset()
    loop.step(sample(9.0), (0.5, 50.0))
    assert laws[0].volts[-1][3] == pytest.approx(0.0)


def test_memory___of_two_joints___is_each_ones_own() -> None:
    text = TEXT.replace("rate: elbow_rpm, ", "")
    rig = described(text)
    loops = [JointLaws(rig, [Fixed(), Fixed()]) for _ in range(2)]
    for k in range(5):
        loops[0].step(sample(0.1 * k, 50.0 - k), (0.5, 50.0))
    loops[1].remember(loops[0].memory())
    assert loops[1].memory() == loops[0].memory()
    assert len({tuple(each) for name, each in loops[1].memory().items() if "rate" in name}) == 2


def test_command_in_force___at_rest___is_none_to_a_law() -> None:
    laws = [Fixed(), Fixed()]
    loop = JointLaws(RIG, laws)
    loop.step(sample(), (0.5, 50.0))
    loop.step(sample(), (0.5, 50.0))
    assert [law.heard for law in laws] == [laws[0].heard] * 2
    loop.step(sample()._replace(commands=(7.0, 6.0, 4.0)), (0.5, 50.0))
    assert laws[0].heard[-1] == pytest.approx((10.0, -10.0))
    assert laws[1].heard[-1] == pytest.approx((5.0, -5.0))


@pytest.mark.parametrize("effort_v", [0.1, 0.7, 1.1, 2.3, 3.3])
def test_answer___that_comes_late___is_not_cut_to_a_law(effort_v: float) -> None:
    """The way to N m and back rounds."""
    laws = [Fixed(), Fixed(effort_v, 0.3)]
    loop = JointLaws(RIG, laws)
    efforts, compensations = loop.step(sample(), (0.5, 50.0))
    first = tuple(np.add(efforts, compensations).tolist())
    laws[1].answer = Effort(4.7, 0.3)
    in_force = sample()._replace(commands=first, compensations=compensations)
    loop.step(in_force, (0.5, 50.0))
    assert laws[1].heard[-1] == (0.0, 0.0)
    loop.step(in_force, (0.5, 50.0))
    assert laws[1].heard[-1] == pytest.approx((effort_v - 4.7, 0.0), abs=1e-12)


def test_friction___of_a_joint___is_a_share_of_its_reach() -> None:
    assert compensation_v(RIG, RIG.joints[0]) == pytest.approx(0.0)
    assert compensation_v(RIG, RIG.joints[1]) == pytest.approx(0.5 / 2.0 * MAX_COMMAND_V)


@pytest.mark.parametrize("change", [("rest: 5", "rest: 7"), ("[1, 7], rest: 5", "[0, 7]")])
def test_law___for_a_joint_whose_input_rests_at_an_end___is_refused(
    change: tuple[str, str],
) -> None:
    spec = cast("LawSpec", SimpleNamespace(name="pd", takes_model=False, uses_outputs=(0, 3)))
    require_known_outputs(spec, RIG)
    with pytest.raises(
        SettingError,
        match=r"^law pd drives joint elbow both ways, and elbow of rig three rests at [70] N m, an "
        r"end of its limits: give it another rest, or take the law servo$",
    ):
        require_known_outputs(spec, described(TEXT.replace(*change)))
