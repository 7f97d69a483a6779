"""Running servo: limits, set-points, memory, file and C code."""

from __future__ import annotations

import shutil
import subprocess
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from flexarm_control import load_controller
from flexarm_control.servo.c_code import c_controller
from flexarm_control.servo.controller import Servo
from flexarm_control.servo.files import save_controller
from flexarm_control.servo.job import ServoRequest, Source, design_servo
from flexarm_control.servo.twin import Twin, perturbed, step_results, step_run
from flexarm_core.errors import SettingError
from flexarm_ident.friction.dry_friction import DryFriction
from support.servo_plants import DT_S, bending_arm, measured_arm, two_joints

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_control.servo.controller import ServoGains
    from flexarm_control.servo.job import ServoDesign
    from flexarm_core.arrays import FloatArray

_MAIN = """
#include <stdio.h>
#include "controller.h"
int main(void)
{
    static servo_controller c;
    double y[SERVO_OUTPUTS], r[SERVO_TRACKED], u[SERVO_INPUTS];
    int i;
    servo_reset(&c);
    for (;;) {
        for (i = 0; i < SERVO_OUTPUTS; i++) if (scanf("%lf", &y[i]) != 1) return 0;
        for (i = 0; i < SERVO_TRACKED; i++) if (scanf("%lf", &r[i]) != 1) return 1;
        servo_step(&c, y, r, u);
        for (i = 0; i < SERVO_INPUTS; i++) printf("%.17g ", u[i]);
        printf("\\n");
    }
}
"""


PAIRS = ((2.0, 0.7), (2.2, 0.7), (5.0, 0.02))


def _turn(value: complex) -> FloatArray:
    return np.array([[value.real, value.imag], [-value.imag, value.real]])


def _joints(limit: float = 1.0) -> ServoDesign:
    model = two_joints()
    friction = DryFriction(
        np.array([0.05, 0.03]),
        np.zeros(2),
        np.zeros(2),
        np.zeros(2),
        np.hstack([np.zeros((2, 2)), np.eye(2)]),
    )
    limits = {"torque1": limit, "torque2": limit}
    request = ServoRequest(("hub1", "hub2"), limits, bandwidth_hz=2.0)
    return design_servo([Source("joints", model, friction)], request)


@pytest.fixture(scope="module")
def joints() -> ServoDesign:
    return _joints()


@pytest.fixture(scope="module")
def gains(joints: ServoDesign) -> ServoGains:
    return joints.gains


def test_step___two_joints_with_friction___settle_without_overshoot(joints: ServoDesign) -> None:
    for result in joints.results:
        assert result.overshoot < 0.02
        assert abs(result.steady_error) < 0.01
        assert result.settling_s < 2.0


@pytest.mark.slow
def test_step___measured_arm_whose_joints_pull_at_each_other___goes_and_stays() -> None:
    # Both hubs at once, in friction of more than half of what the second one moves with.
    request = ServoRequest(("hub1_deg", "hub2_deg"), {}, bandwidth_hz=0.65)
    design = design_servo([measured_arm()], request)

    for result in design.results:
        assert result.overshoot < 0.02
        assert abs(result.steady_error) < 0.02
    overshoots = [each.overshoot for results in design.other_results for each in results]
    assert max(overshoots) < 0.05


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_friction___speeds_that_take_a_part_of_the_position___are_those_of_the_joints(
    sign: float,
) -> None:
    request = ServoRequest(("hub1", "hub2"), {"torque1": 1.0, "torque2": 1.0}, bandwidth_hz=1.0)
    unknown = np.zeros(2)
    speed = np.array([[0.06, 0.02, 1.0, 0.0], [-0.03, 0.05, 0.0, 1.0]])
    friction = DryFriction(np.array([0.05, 0.02]), unknown, unknown, unknown, sign * speed)

    gains = design_servo([Source("joints", two_joints(), friction)], request).gains

    own = np.diag(gains.onsets)
    assert (own > 0.0).all()
    np.testing.assert_allclose(gains.onsets / own[:, np.newaxis], np.eye(2), atol=0.02)


def test_perturbed___damped_pairs_that_cancel_each_other___stay() -> None:
    # Two of 2 and 2.2 Hz, 70 % damped, and a vibration of 5 Hz.
    speeds = [2.0 * np.pi * hz * complex(-zeta, np.sqrt(1.0 - zeta**2)) for hz, zeta in PAIRS]
    A = block_diag(*[_turn(np.exp(speed * DT_S)) for speed in speeds])
    model = control.StateSpace(A, np.ones((6, 1)), np.ones((1, 6)), 0.0, DT_S)

    changed = perturbed(Twin(model, np.zeros(1), np.zeros((1, 6)), np.zeros(1)), 1, 0.2).model

    np.testing.assert_allclose(changed.A[:4, :4], model.A[:4, :4], atol=1e-12)
    assert np.abs(changed.A[4:, 4:] - model.A[4:, 4:]).max() > 1e-4


def test_step___any_set_point___stays_within_the_limits(gains: ServoGains) -> None:
    servo = Servo(gains)
    rng = np.random.default_rng(1)

    commands = np.array([servo.step(rng.normal(size=2), [5.0, -5.0]) for _ in range(500)])

    assert np.abs(commands).max() == pytest.approx(1.0)


def test_step___large_step___is_slowed_down_to_the_limits(gains: ServoGains) -> None:
    twin = Twin(two_joints(), np.zeros(2), np.zeros((2, 4)), np.zeros(2))
    steps = np.array([20.0, -20.0])

    run = step_run(Servo(gains), twin, steps, 60.0, seed=0)

    for result in step_results(Servo(gains), run, steps):
        assert result.overshoot < 0.02
        assert result.settling_s < 60.0
    # What a saturated command had wound up would show as overshoot; here it is never reached.
    assert np.abs(run.u).max() < 1.0


def test_step___after_a_hold_at_the_limit___returns_without_windup(gains: ServoGains) -> None:
    servo = Servo(gains)
    servo.reset()
    for _ in range(2000):
        # Something holds the arm away from its set-point.
        servo.step([0.0, 0.0], [0.5, 0.0])
    held = servo.step([0.0, 0.0], [0.5, 0.0])
    freed = [servo.step([1.0, 0.0], [0.5, 0.0])[0] for _ in range(200)]

    assert held[0] == pytest.approx(1.0)
    assert min(freed) < 0.0


def test_reset___first_sample_elsewhere___asks_for_no_motion(gains: ServoGains) -> None:
    servo = Servo(gains)

    command = servo.step([0.8, -0.3], [0.8, -0.3])

    assert command == pytest.approx([0.0, 0.0], abs=1e-9)


def test_reset___after_a_run___gives_the_same_commands(gains: ServoGains) -> None:
    servo = Servo(gains)
    records = []
    for _ in range(2):
        servo.reset()
        records.append([servo.step([0.0, 0.01 * k], [0.1, 0.0]) for k in range(50)])

    np.testing.assert_allclose(records[0], records[1], rtol=0.0, atol=1e-12)


def test_hear___command_that_was_not_applied___corrects_the_expected_state(
    gains: ServoGains,
) -> None:
    free = replace(gains, levels=np.zeros(2))
    reported, limited = Servo(free), Servo(replace(free, limits=np.full(2, 0.1)))
    y, r = [0.0, 0.0], [1.0, 1.0]
    for _ in range(300):
        wanted = np.array(reported.step(y, r))
        reported.hear(np.clip(wanted, -0.1, 0.1).tolist())
        limited.step(y, r)

    # Commands at their limit would hide what the filters expect.
    np.testing.assert_allclose(
        reported.memory()["state"], limited.memory()["state"], rtol=1e-9, atol=1e-9
    )


def test_step___wrong_number_of_outputs___is_refused(gains: ServoGains) -> None:
    with pytest.raises(ValueError, match="shape"):
        Servo(gains).step([0.0, 0.0, 0.0], [0.0, 0.0])


def test_save_controller___loaded___has_every_number(gains: ServoGains, tmp_path: Path) -> None:
    file = tmp_path / "controller.yaml"
    save_controller(file, gains)

    loaded = load_controller(file)

    assert (loaded.inputs, loaded.tracked) == (["torque1", "torque2"], ["hub1", "hub2"])
    for name in loaded.law._fields[:-1]:
        np.testing.assert_array_equal(getattr(loaded.gains, name), getattr(gains, name))


def test_save_controller___without_limits___keeps_them_infinite(tmp_path: Path) -> None:
    design = design_servo(
        [Source("arm", bending_arm())], ServoRequest(("hub",), {}, bandwidth_hz=1.0)
    )
    save_controller(tmp_path / "controller.yaml", design.gains)

    assert np.isinf(load_controller(tmp_path / "controller.yaml").gains.limits).all()
    assert any("--limit torque" in note for note in design.notes)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("rate_hz: 500.0", "rate_hz: 0.0", "rate_hz"),
        ("states: 6", "states: 7", "servo.a"),
        ("tracked: [", "tracked: [other, ", "other"),
        ("limits: [", "limits: [.nan, ", "servo.limits"),
        ("inputs: [", "entries: [", "servo.inputs"),
    ],
)
def test_load_controller___damaged_file___names_file_and_field(
    gains: ServoGains, tmp_path: Path, old: str, new: str, said: str
) -> None:
    file = tmp_path / "controller.yaml"
    save_controller(file, gains)
    text = _in_one_line(file.read_text("utf-8"))
    assert old in text
    file.write_text(text.replace(old, new, 1), "utf-8")

    with pytest.raises(SettingError, match=said) as caught:
        load_controller(file)

    assert str(file) in str(caught.value)


def _in_one_line(text: str) -> str:
    """Return a YAML text whose lists of names stand in one line each."""
    import yaml  # noqa: PLC0415 - for this test alone

    return yaml.safe_dump(yaml.safe_load(text), default_flow_style=None, width=10**9)


def test_load_controller___other_file___says_what_to_name(tmp_path: Path) -> None:
    (tmp_path / "gains.yaml").write_text("/**:\n  ros__parameters:\n    law: pd\n", "utf-8")

    with pytest.raises(SettingError, match="name a controller"):
        load_controller(tmp_path / "gains.yaml")
    with pytest.raises(SettingError, match="No such file"):
        load_controller(tmp_path / "none.yaml")


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("compiler", [("cc", "-std=c99"), ("c++", "-x", "c++", "-std=c++11")])
def test_c_controller___compiled___gives_the_commands_of_python(
    gains: ServoGains, tmp_path: Path, compiler: tuple[str, ...]
) -> None:
    # One of a servo is A, which would hide that one is taken for the other.
    gains = replace(gains, deviation=0.99 * gains.A)
    (tmp_path / "controller.h").write_text(c_controller(gains), "utf-8")
    (tmp_path / "main.c").write_text(_MAIN, "utf-8")
    program = tmp_path / "main"
    warnings = ("-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused")
    files = [str(tmp_path / "main.c"), "-o", str(program)]
    subprocess.run([*compiler, *warnings, *files], check=True)  # noqa: S603 - our own text
    rng = np.random.default_rng(3)
    rows = np.hstack(
        [
            np.cumsum(0.002 * rng.standard_normal((3000, 2)), axis=0),
            np.repeat(rng.normal(size=(6, 2)), 500, axis=0),
        ]
    )
    servo = Servo(gains)
    expected = [servo.step(row[:2], row[2:]) for row in rows]

    text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    done = subprocess.run(  # noqa: S603 - our own program
        [program], input=text, capture_output=True, text=True, check=True
    )

    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=np.float64)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_step___twenty_states___takes_less_than_twenty_microseconds(gains: ServoGains) -> None:
    order = 20
    rng = np.random.default_rng(0)
    large = replace(
        gains,
        A=0.9 * np.eye(order),
        B=rng.normal(size=(order, 2)),
        C=rng.normal(size=(2, order)),
        feedback=rng.normal(size=(2, order)),
        correction=1e-3 * rng.normal(size=(order, 2)),
        deviation=0.9 * np.eye(order),
        planning=rng.normal(size=(2, order)),
        rest=np.zeros((order, 2)),
    )
    servo = Servo(large)
    y, r = [0.1, 0.2], [0.3, 0.4]
    taken_s = []
    # Its own time, the best of several: other programs share the machine.
    for _ in range(20):
        begun = time.thread_time()
        for _ in range(500):
            servo.step(y, r)
        taken_s.append((time.thread_time() - begun) / 500)

    assert min(taken_s) < 20e-6
    assert servo.rate_hz == pytest.approx(1.0 / DT_S)
