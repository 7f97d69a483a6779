"""Answers of an arm that is right, and of others that are wired wrongly, to known physics."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control.commissioning.answers import (
    Accuracy,
    ArmFaultError,
    PulseAnswer,
    friction_levels,
    judge_pulses,
    of_joints,
    require_all_answer,
    soft_loop,
)
from flexarm_core.rig_description import described
from flexarm_daq.experiments.excitation import Pulses
from flexarm_ident import IoData
from support.exhaustive import first_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_core.rig_description import RigDescription

RATE_HZ = 500.0
GAIN, COULOMB = 20.0, 0.08
NOISE = 5e-4
TEXT = """
name: arm
rate_hz: 500
inputs:
  torque: {unit: '-', limits: 1}
  other: {unit: '-', limits: 1}
outputs:
  angle: {quantity: angle, unit: rad}
  rate: {quantity: rate, unit: rad/s}
  gauge: {unit: '-'}
  elbow: {quantity: angle, unit: rad}
joints:
  hub: {input: torque, angle: angle, rate: rate, travel: 1.5}
  elbow: {input: other, angle: elbow, travel: 1.5}
driver: twin
"""


def rig() -> RigDescription:
    """Return an arm with a hub, which is driven here, and an elbow."""
    return described(TEXT)


def moved(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return angles and rates of a hub with friction, in fine steps."""
    fine = 4
    step_s = 1.0 / RATE_HZ / fine
    angle = rate = 0.0
    found = np.empty((len(u), 2))
    for k, command in enumerate(u):
        found[k] = angle, rate
        for _ in range(fine):
            free = rate + step_s * GAIN * command
            rate = math.copysign(max(abs(free) - step_s * GAIN * COULOMB, 0.0), free)
            angle += step_s * rate
    return found[:, 0], found[:, 1]


class Geared:
    """A motor with a tenth of the arm's inertia and a third of its friction, behind a gear."""

    def __init__(self, play: float) -> None:
        self.play = play
        self.angles, self.rates = np.zeros(2), np.zeros(2)

    def turn(self, command: float) -> None:
        """Move motor and arm on by a sample, of fine steps."""
        fine = 40
        step_s = 1.0 / RATE_HZ / fine
        for _ in range(fine):
            twist = self.angles[0] - self.angles[1]
            tooth = math.copysign(max(abs(twist) - 0.5 * self.play, 0.0), twist)
            slip = self.rates[0] - self.rates[1]
            torque = 400.0 * tooth + (0.5 * slip if tooth else 0.0)
            free = self.rates + step_s * GAIN * np.array([10.0 * (command - torque), torque])
            held = step_s * GAIN * COULOMB * np.array([3.0, 0.7])
            self.rates = np.copysign(np.maximum(np.abs(free) - held, 0.0), free)
            self.angles = self.angles + step_s * self.rates


def pulsed(
    change: Callable[[np.ndarray], np.ndarray] = lambda y: y,
    *,
    stuck: bool = False,
    gear: Geared | None = None,
    angle_of: int = 0,
) -> IoData:
    """Return a record of pulses on the hub, whose outputs are changed as a fault does.

    With a gear the rate is that of its motor, and the angle that of the motor, 0, or the arm, 1.
    """
    pulses = Pulses(5.0)
    u, geared = np.zeros(3000), np.zeros((3000, 2))
    angle = rate = 0.0
    # The pulses end when they have moved the hub, of which they read 6.857 V for 1.5 rad.
    for k in range(len(u)):
        u[k] = 0.1 * pulses.step(k / RATE_HZ, angle * 6.857142857 / 1.5)
        if gear:
            geared[k] = gear.angles[angle_of], gear.rates[0]
            gear.turn(u[k])
            angle = gear.angles[angle_of]
            continue
        free = rate + GAIN * u[k] / RATE_HZ
        rate = math.copysign(max(abs(free) - GAIN * COULOMB / RATE_HZ, 0.0), free)
        angle += 0.0 if stuck else rate / RATE_HZ
    angles, rates = geared.T if gear else moved(u)
    hub = np.zeros_like(angles) if stuck else angles
    speed = np.zeros_like(rates) if stuck else rates
    y = change(np.column_stack([hub, speed, 0.5 * u, np.zeros(len(u))]))
    y = y + NOISE * np.random.default_rng(1).standard_normal(y.shape)
    return IoData(
        np.column_stack([u, np.zeros(len(u))]),
        y,
        dt_s=1.0 / RATE_HZ,
        inputs=rig().input_names,
        outputs=rig().output_names,
    )


def test_right_arm___moves_as_its_physics_says() -> None:
    answer = judge_pulses(pulsed(), rig(), rig().joints[0])

    # The pulse of 0.1 s moves a mass by g (h - c) t^2 / 2, and the gain is that for no friction.
    assert answer.way == pytest.approx(0.5 * GAIN * (answer.height - COULOMB) * 0.01, abs=3e-3)
    assert answer.gain == pytest.approx(GAIN * (1.0 - COULOMB / answer.height), rel=0.1)
    assert set(answer.answering) == {"rate", "gauge"}


def column(number: int, factor: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return a fault that multiplies one output."""
    return lambda y: y * np.where(np.arange(4) == number, factor, 1.0)


@pytest.mark.parametrize(
    ("change", "stuck", "words"),
    [
        (lambda y: -y, False, "reversed wiring: a positive torque turns angle the other way"),
        (lambda y: 0.0 * y, False, "dead output, or stuck joint: nothing answers to torque"),
        (lambda y: y, True, "stuck joint, or dead sensor: gauge answers to torque"),
        (column(0, 0.0), False, "dead sensor: rate answers to torque.*angle does not"),
        (column(1, 0.0), False, "dead sensor: rate does not answer while angle moves"),
        (column(1, -1.0), False, "reversed wiring: rate has the other sign"),
        (
            lambda y: y[:, [3, 1, 2, 0]] * [1, 0, 1, 1],
            False,
            "or dead sensor: torque turns elbow and not hub",
        ),
    ],
    ids=["reversed", "output", "stuck", "angle", "rate", "rate's sign", "exchanged"],
)
def test_wrong_arm___is_refused_with_the_right_word(
    change: Callable[[np.ndarray], np.ndarray], words: str, *, stuck: bool
) -> None:
    with pytest.raises(ArmFaultError, match=words):
        judge_pulses(pulsed(change, stuck=stuck), rig(), rig().joints[0])


@pytest.mark.parametrize(
    ("angle_of", "words"),
    first_of(
        [
            (0, "loose gear: angle moves by 0.0.* and by no more than"),
            (1, "loose gear: angle and rate do not move together"),
        ]
    ),
    ids=["motor", "arm"],
)
def test_play_between_motor_and_arm___is_a_loose_gear(angle_of: int, words: str) -> None:
    right = judge_pulses(pulsed(gear=Geared(0.0), angle_of=angle_of), rig(), rig().joints[0])
    assert right.way > 0.0
    with pytest.raises(ArmFaultError, match=words):
        judge_pulses(pulsed(gear=Geared(0.03), angle_of=angle_of), rig(), rig().joints[0])


@pytest.mark.parametrize("part", ["no rise", "no fall"])
def test_pulses_that_are_not_whole___are_refused(part: str) -> None:
    record = pulsed()
    u = record.u[:, 0]
    if part == "no rise":
        kept = np.minimum(u, 0.0)
    else:
        last_fall = np.flatnonzero((u[1:] < 0.0) & (u[:-1] >= 0.0))[-1] + 1
        kept = np.where(np.arange(len(u)) < last_fall, u, 0.0)

    with pytest.raises(ArmFaultError, match="last pulse on torque is not in the record"):
        judge_pulses(
            replace(record, u=np.column_stack([kept, record.u[:, 1]])), rig(), rig().joints[0]
        )


def test_description_with_the_other_sign___takes_the_reversed_arm() -> None:
    joint = replace(rig().joints[0], sign=-1)

    assert judge_pulses(pulsed(lambda y: -y), rig(), joint).way < 0.0


def test_gauge_that_answers_to_no_joint___is_refused() -> None:
    answers = [
        judge_pulses(pulsed(column(2, 0.0)), rig(), rig().joints[0]),
        PulseAnswer("elbow", 0.1, 0.1, 1.0, ()),
    ]

    with pytest.raises(ArmFaultError, match="dead sensor: gauge answers to no joint"):
        require_all_answer(answers, rig())


def test_soft_loop___has_its_frequency_and_damping() -> None:
    one = described(TEXT.replace("  elbow: {input: other, angle: elbow, travel: 1.5}\n", ""))
    loop = soft_loop([PulseAnswer("hub", 0.1, 0.1, GAIN, ())], one)

    # 10 V are the limit of 1, 6.857 V the travel of 1.5 rad, 0.2014 V a rate of 1 rad/s at 4.911 V.
    volts = 6.857142857 / 1.5
    stiffness = GAIN * 0.1 * volts * loop.kp
    damping = GAIN * 0.1 * volts * loop.kd * 0.2014 / 4.9110668154
    assert math.sqrt(stiffness) == pytest.approx(2.0 * math.pi * 0.8, rel=1e-3)
    assert damping / (2.0 * math.sqrt(stiffness)) == pytest.approx(0.4, rel=1e-3)


def slow_motion(level: float, viscous: float, height: float, half_s: float) -> IoData:
    """Return a record of ramps to and fro, whose motion takes dry and viscous friction."""
    time_s = np.arange(round(4.5 * half_s * RATE_HZ)) / RATE_HZ
    phase = time_s / (2.0 * half_s) + 0.25
    angle = height * (1.0 - 4.0 * np.abs(phase % 1.0 - 0.5))
    direction = np.where(phase % 1.0 < 0.5, 1.0, -1.0)
    command = (level + viscous * height / 0.3) * direction
    noise = 0.01 * np.random.default_rng(round(10.0 * height)).standard_normal((len(time_s), 2))
    return IoData(
        (command + 0.02)[:, None] * [1.0, 2.0] + noise,
        np.column_stack([angle, direction, 0.0 * angle, angle]),
        dt_s=1.0 / RATE_HZ,
        inputs=rig().input_names,
        outputs=rig().output_names,
    )


@pytest.mark.parametrize("viscous", [0.0, 0.02])
@pytest.mark.parametrize("level", [0.0, 0.05, 0.3])
def test_friction___dry_and_viscous___are_distinguished_by_two_speeds(
    level: float, viscous: float
) -> None:
    half_s = 2.0
    records = [slow_motion(level, viscous, height, half_s) for height in (0.3, 0.6)]
    hub, elbow = friction_levels(records, rig(), half_s)
    # Means of 500 samples, of which four of each speed: 1.3e-3 for dry friction.
    assert (hub.level, elbow.level) == pytest.approx((level, 2.0 * level), abs=4e-3)
    assert (hub.viscous, elbow.viscous) == pytest.approx((viscous, 2.0 * viscous), abs=4e-3)
    assert (hub.offset, elbow.offset) == pytest.approx((0.02, 0.04), abs=1e-3)
    assert 1e-4 < hub.deviation < 3e-3
    assert hub.text.startswith("below") == (level == 0.0)


def test_inputs_that_turn_no_joint___are_no_part_of_the_record() -> None:
    text = TEXT.replace("  elbow: {input: other, angle: elbow, travel: 1.5}\n", "")
    record = replace(pulsed(), compensation=np.ones((3000, 2)) * [3.0, 4.0])
    found = of_joints(record, described(text))
    assert found.inputs == ("torque",)
    np.testing.assert_array_equal(found.u, record.u[:, :1])
    assert found.compensation is not None
    assert np.unique(found.compensation).tolist() == [3.0]


def test_joint_that_does_not_follow_slow_motion___is_refused() -> None:
    record = pulsed(stuck=True)

    with pytest.raises(ArmFaultError, match="stuck joint: hub does not follow"):
        friction_levels([replace(record, y=0.0 * record.y)] * 2, rig(), 1.0)


def test_accuracy___says_what_exceeds_the_goal() -> None:
    assert Accuracy(0.01, 0.02).misses(0.05) == ""
    assert Accuracy(math.nan, math.nan).misses(0.05) == ""
    said = Accuracy(0.1, 0.02).misses(0.05)
    assert said == "the frequency of a mode is known to ±10 %, and the goal is 5 %"
