"""Self-test of rigs that are not the thesis's arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import RigDescription, described
from flexarm_daq.loop.limiter import rig_gate
from flexarm_daq.loop.self_test import (
    PULSE,
    SelfTestError,
    check_possible,
    run_self_test,
)
from flexarm_daq.rigs.rig_protocol import Rig, RigSample

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Wiring = Callable[[NDArray[np.float64]], NDArray[np.float64]]

RATE_HZ = 300.0


def scaled(channel: int, factor: float, offset: float = 0.0) -> Wiring:
    def wire(readings: NDArray[np.float64]) -> NDArray[np.float64]:
        readings[channel] = factor * readings[channel] + offset
        return readings

    return wire


TWO_JOINTS = described(
    """
name: two
rate_hz: 300
inputs:
  torque1: {quantity: torque, unit: N m, limits: 5}
  torque2: {quantity: torque, unit: N m, limits: [1, 9], rest: 5}
outputs:
  hub1: {quantity: angle, unit: rad}
  hub2: {quantity: angle, unit: rad}
  rate1: {quantity: rate, unit: rad/s}
  rate2: {quantity: rate, unit: rad/s, range: 3}
  sum: {unit: rad/s}
joints:
  one: {input: torque1, angle: hub1, rate: rate1, travel: 1}
  two: {input: torque2, angle: hub2, rate: rate2, travel: 1}
driver: rig.py:Mine
"""
)


class FreeJoints:
    """Two joints without friction, each turned by a motor of its own; `wiring` is of the readings.

    Their rates are the integrals of the commands from rest, and their angles those of the rates.
    """

    def __init__(
        self, wiring: Wiring = lambda readings: readings, *, crossed: bool = False
    ) -> None:
        self._wiring = wiring
        self._motors = [1, 0] if crossed else [0, 1]
        self.written: list[tuple[float, ...]] = []

    def open(self) -> None:
        self._angles, self._rates = np.zeros(2), np.zeros(2)

    def read(self) -> RigSample:
        readings = np.array([*self._angles, *self._rates, self._rates.sum()])
        return RigSample(len(self.written) / RATE_HZ, self._wiring(readings))

    def write(self, commands: Sequence[float]) -> None:
        self.written.append(tuple(commands))
        torques = np.array(commands)[self._motors] - np.array([0.0, 5.0])[self._motors]
        self._angles += self._rates / RATE_HZ
        self._rates += torques / RATE_HZ

    def safe_stop(self) -> None:
        self.write([0.0, 5.0])

    def close(self) -> None:
        self.safe_stop()


def run_two(rig: Rig) -> None:
    run_self_test(rig, rig_gate(TWO_JOINTS), TWO_JOINTS, RATE_HZ, paced=False)


def test_two_joints___pulsed_in_turn___are_right() -> None:
    rig = FreeJoints()
    run_two(rig)
    written = np.array(rig.written) - [0.0, 5.0]
    assert np.all((written == 0.0).any(axis=1))
    np.testing.assert_allclose(np.abs(written).max(axis=0), [PULSE * 5.0, PULSE * 4.0])
    np.testing.assert_allclose(written.sum(axis=0), 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("rig", "reported"),
    [
        (
            FreeJoints(lambda y: y * [1.0, -1.0, 1.0, -1.0, 1.0]),
            (
                "hub2 answers torque2 with the wrong sign: swap the wires, or set sign: -1 for "
                "joint two"
            ),
        ),
        (
            FreeJoints(scaled(2, -1.0)),
            "rate1 answers torque1 with the wrong sign: swap its wires, or make its scale negative",
        ),
        (
            FreeJoints(scaled(1, 1.0, 0.9)),
            (
                "hub2 reads 0.90 rad: turn the arm to the middle, within 0.73 rad, by hand; else "
                "check the sensor"
            ),
        ),
        (
            FreeJoints(scaled(1, 0.0, 0.3)),
            "hub2 does not answer torque2: check sensor, wire and terminal",
        ),
        (
            FreeJoints(scaled(3, 0.0, 3.0)),
            "rate2 is at the end of the input range: check its supply and wires",
        ),
        (
            FreeJoints(crossed=True),
            (
                "no channel answers torque1: check the drive's power, the emergency stop and the "
                "wire of the command"
            ),
        ),
    ],
    ids=[
        "reversed motor",
        "reversed rate",
        "far joint",
        "dead angle",
        "rate at its end",
        "crossed",
    ],
)
def test_two_joints___with_a_fault___are_refused_with_its_name(
    rig: FreeJoints, reported: str
) -> None:
    with pytest.raises(SelfTestError) as raised:
        run_two(rig)
    assert str(raised.value) == f"self-test: {reported}"
    assert rig.written[-1] == (0.0, 5.0)


def test_check_possible___arm_without_joints___says_so() -> None:
    lamp = described(
        "name: lamp\nrate_hz: 300\ndriver: rig.py:Mine\n"
        "inputs: {heat: {unit: W, limits: 5}}\noutputs: {warmth: {unit: K}}\n"
    )
    with pytest.raises(SettingError, match="lamp has none: set self_test:=off"):
        check_possible(lamp, 300.0, 10.0)


UNEVEN = described(
    """
name: uneven
rate_hz: 300
inputs:
  lamp: {unit: W, limits: [0, 40], rest: 7}
  motor: {quantity: torque, unit: N m, limits: [-2, 8], rest: 1}
outputs:
  eye: {unit: x, range: 1, absent: true}
  hub: {quantity: angle, unit: deg, range: [0, 360], wrap: 360}
  rate: {quantity: rate, unit: deg/s}
joints:
  hub: {input: motor, angle: hub, rate: rate, travel: [-20, 100], sign: -1}
driver: rig.py:Mine
"""
)


class Uneven:
    """A joint of 40 degrees without friction, which a positive command turns down.

    Its encoder has steps of `step` degrees, and begins at 40 degrees but for `start`.
    """

    def __init__(
        self, start: float = 40.0, step: float = 0.01, gain: float = 200.0, creep: float = 0.0
    ) -> None:
        self._start, self._step, self._gain, self._creep = start, step, gain, creep
        self.written: list[tuple[float, ...]] = []

    def open(self) -> None:
        self._angle, self._rate = self._start, 0.0

    def read(self) -> RigSample:
        turned = self._angle + (self._creep if len(self.written) > 100 else 0.0)
        counts = np.rint(turned / self._step)
        return RigSample(0.0, np.array([1.0, self._step * counts, self._rate]))

    def write(self, commands: Sequence[float]) -> None:
        self.written.append(tuple(commands))
        self._angle += self._rate / RATE_HZ
        self._rate -= self._gain * (commands[1] - 1.0) / RATE_HZ

    def safe_stop(self) -> None:
        self.write([7.0, 1.0])

    def close(self) -> None:
        self.safe_stop()


def run_uneven(rig: Rig, description: RigDescription = UNEVEN) -> None:
    run_self_test(rig, rig_gate(description), description, RATE_HZ, paced=False)


def test_joint___of_uneven_ends_and_negative_sign___is_right() -> None:
    rig = Uneven()
    run_uneven(rig)
    written = np.array(rig.written)
    np.testing.assert_allclose(written[:, 0], 7.0)
    # As far up as down: the nearer end is 3 N m from rest.
    np.testing.assert_allclose([written[:, 1].min(), written[:, 1].max()], [0.4, 1.6])


def test_joint___of_negative_sign_that_turns_the_other_way___is_asked_to_set_the_sign() -> None:
    with pytest.raises(SelfTestError, match=r"set sign: 1 for joint hub$"):
        run_uneven(Uneven(gain=-200.0))


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_encoder___that_begins_at_an_end_of_its_range___is_right(start: float) -> None:
    """One that counts from where it was switched on."""
    middle = described(UNEVEN.text.replace("travel: [-20, 100]", "travel: [-60, 60]"))
    run_uneven(Uneven(start), middle)


def test_joint___far_from_the_middle_of_uneven_travel___is_refused() -> None:
    run_uneven(Uneven(82.0))
    with pytest.raises(SelfTestError, match=r"hub reads -5\.00 deg: turn the arm to the middle"):
        run_uneven(Uneven(-5.0))


def test_encoder___of_a_long_counter___is_judged_by_its_steps() -> None:
    """Its range of 32 bits is not a measure of its noise."""
    counter = described(
        UNEVEN.text.replace("range: [0, 360], wrap: 360", "range: 2e+7, wrap: 4e+7")
    )
    run_uneven(Uneven(), counter)


@pytest.mark.parametrize("creep", [0.09, -0.09, 0.17])
def test_encoder___that_creeps_by_a_step_without_power___is_silent(creep: float) -> None:
    with pytest.raises(SelfTestError, match="no channel answers motor"):
        run_uneven(Uneven(step=0.088, gain=0.0, creep=creep))


def test_check_possible___input_that_rests_at_an_end___says_so() -> None:
    check_possible(UNEVEN, 300.0, 10.0)
    one_way = described(UNEVEN.text.replace("[-2, 8], rest: 1", "[0, 8]"))
    with pytest.raises(
        SettingError,
        match=r"^the self-test pulses joint hub both ways, and motor of rig uneven rests at 0 N m, "
        r"an end of its limits: give it another rest, or set self_test:=off$",
    ):
        check_possible(one_way, 300.0, 10.0)


def test_joint___without_any_sensor___is_reported_and_not_passed() -> None:
    blind = FreeJoints()
    setattr(blind, "absent_channels", ("hub1", "rate1"))  # noqa: B010 - as a driver of a user has it
    with pytest.raises(SelfTestError, match="joint one has no sensor that could answer"):
        run_two(blind)
