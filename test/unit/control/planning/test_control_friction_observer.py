"""The observer of friction, beside the step response of a first-order low-pass."""

from __future__ import annotations

from math import exp, pi

import pytest

from flexarm_control.laws.planned import FrictionObserver, FrictionSensing

RATE_HZ = 300.0
SENSING = FrictionSensing(observer_hz=5.0)


@pytest.mark.parametrize("friction_v", [-0.4, 0.2])
def test_observer___constant_friction___follows_it_as_a_low_pass(friction_v: float) -> None:
    observer = FrictionObserver(SENSING, RATE_HZ)
    speed_v = 0.0
    for sample in range(1, 200):
        # The gauge shows the torque that the arm gets: the command less friction.
        strain_v = (observer.state[2] - friction_v) / SENSING.command_per_strain
        found_v = observer.step((0.0, strain_v, 0.0, speed_v), 1.5)
        expected_v = friction_v * (1.0 - exp(-2.0 * pi * 5.0 * sample / RATE_HZ))
        assert found_v == pytest.approx(expected_v, abs=1e-9)


def test_observer___command_that_accelerates_the_hub___is_no_friction() -> None:
    observer = FrictionObserver(SENSING, RATE_HZ)
    acceleration_v_per_s, speed_v, effort_v = 2.0, 0.0, 0.0
    for _ in range(300):
        speed_v += acceleration_v_per_s / RATE_HZ
        # The arm takes what the observer adds.
        strain_v = (observer.state[2] - effort_v) / SENSING.command_per_strain
        effort_v = SENSING.command_per_acceleration_s * acceleration_v_per_s
        effort_v += SENSING.command_per_speed * speed_v
        found_v = observer.step((0.0, strain_v, 0.0, speed_v), effort_v)

    # The command in force is one sample old, the low-pass a few.
    assert found_v == pytest.approx(0.0, abs=0.005)


def test_observer___without_a_low_pass___finds_nothing() -> None:
    observer = FrictionObserver(FrictionSensing(), RATE_HZ)

    assert observer.step((0.0, 1.0, 0.0, 1.0), 3.0) == 0.0
