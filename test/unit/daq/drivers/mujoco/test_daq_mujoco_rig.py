from __future__ import annotations

from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described, load_rig
from flexarm_daq.drivers.at_rest import read_at_rest
from flexarm_daq.drivers.mujoco.rig import MujocoArm, MujocoRig, MujocoSettings
from flexarm_daq.drivers.registry import driven
from flexarm_daq.drivers.settings import settings_of
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

mujoco: Any = pytest.importorskip("mujoco", reason="the engine: pip install mujoco")

HERE = Path()
# A wheel on a spring, whose motion is known in closed form.
SPRING = """\
<mujoco>
  <option timestep="1e-4" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody><body name="wheel">
    <joint name="axis" type="hinge" axis="0 0 1" stiffness="0.5" damping="0.01"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.02 0.02 0.02"/>
    <site name="rim" pos="1 0 0"/>
  </body></worldbody>
  <actuator><motor name="motor" joint="axis"/></actuator>
  <sensor><jointpos name="angle" joint="axis"/><gyro name="gyro" site="rim"/></sensor>
</mujoco>
"""
ROBOT = """\
<robot name="arm">
  <link name="base"/>
  <link name="wheel"><inertial><mass value="1"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="axis" type="continuous">
    <parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint>
</robot>
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "spring.xml").write_text(SPRING)
    (tmp_path / "robot.urdf").write_text(ROBOT)
    return tmp_path


def spring(**changes: object) -> MujocoSettings:
    settings = MujocoSettings(
        model="spring.xml",
        actuators=("motor",),
        sensors=("angle", "gyro[2]"),
        rate_hz=500.0,
        substeps=20,
    )
    return replace(settings, **changes)  # type: ignore[arg-type]


def run(rig: MujocoRig, commands: FloatArray) -> FloatArray:
    """Return the samples, (commands, outputs), each read before its command."""
    rig.open()
    samples = []
    for command in commands:
        samples.append(rig.read()[1])
        rig.write(command.tolist())
    rig.close()
    return np.array(samples)


@pytest.mark.parametrize(("delay_s", "frame_hz"), [(0.02, 0.0), (0.0, 60.0), (0.013, 100.0)])
def test_camera___says_the_frame_that_was_taken_before_its_delay(
    folder: Path, delay_s: float, frame_hz: float
) -> None:
    commands = np.random.default_rng(4).standard_normal((200, 1))
    plain = spring(noise=(1e-3, 1e-3), seed=5)
    camera = replace(plain, delay_s=(delay_s, 0.0), frame_hz=(frame_hz, 0.0))
    direct = run(MujocoRig(plain, folder), commands)
    seen = run(MujocoRig(camera, folder), commands)

    # Exact in whole microseconds; the first reading stands until the first frame has come.
    now_us = 2000 * np.arange(len(commands))
    taken_us = now_us - round(1e6 * delay_s)
    if frame_hz:
        frames = (taken_us * round(frame_hz)) // 1_000_000
        taken_us = frames * 1_000_000 // round(frame_hz)
    expected = np.maximum(taken_us // 2000, 0)
    assert seen[:, 0] == pytest.approx(direct[expected, 0], abs=0.0)
    assert seen[:, 1] == pytest.approx(direct[:, 1], abs=0.0)


def test_settings___delays_of_some_outputs_only___are_refused() -> None:
    with pytest.raises(SettingError, match=r"settings\.delay_s needs a number from 0 on for each"):
        spring(delay_s=(0.1,))


@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4])
def test_thesis_arm___modes___are_those_of_the_beam_within_a_percent(payload_kg: float) -> None:
    settings = settings_of(MujocoSettings, load_rig("mujoco-thesis"), rate_hz=300.0)
    arm = MujocoArm(replace(settings, payload_kg=payload_kg), HERE)
    expected_hz = natural_frequencies_hz(RigParameters(payload_kg=payload_kg), 4)
    np.testing.assert_allclose(modes_hz(arm)[:4], expected_hz, rtol=0.01)


def modes_hz(arm: MujocoArm) -> FloatArray:
    """Return the natural frequencies of MuJoCo's own linearisation, without dry friction."""
    arm.model.dof_frictionloss[:] = 0.0
    state, _ = transition(arm)
    poles = np.log(np.linalg.eigvals(state).astype(complex)) / arm.step_s
    frequencies_hz: FloatArray = np.sort(np.abs(poles[poles.imag > 1.0])) / (2.0 * np.pi)
    return frequencies_hz


def transition(arm: MujocoArm) -> tuple[FloatArray, FloatArray]:
    """Return the matrices of one step of the engine, by its own finite differences."""
    model, states = arm.model, 2 * arm.model.nv
    state, effect = np.zeros((states, states)), np.zeros((states, model.nu))
    mujoco.mjd_transitionFD(model, arm.data, 1e-6, True, state, effect, None, None)  # noqa: FBT003
    return state, effect


def test_two_links___small_motion___is_that_of_the_engines_own_linearisation() -> None:
    description = load_rig("mujoco-two-link")
    settings = settings_of(MujocoSettings, description, rate_hz=description.rate_hz)
    arm = MujocoArm(settings, HERE)
    state, effect = transition(arm)
    period = np.linalg.matrix_power(state, arm.substeps)
    within = sum(np.linalg.matrix_power(state, k) for k in range(arm.substeps)) @ effect
    # Below the friction, which holds in the linearisation as in the engine: the links bend.
    commands = 1e-3 * np.random.default_rng(1).standard_normal((40, 2))
    x, expected = np.zeros(len(state)), []
    rows = [arm.model.joint(name).dofadr[0] for name in ("shoulder", "elbow", "upper1", "lower1")]
    for command in commands:
        expected.append(x[rows] * [1.0, 1.0, 30.0, 15.0])
        x = period @ x + within @ command
    measured = run(MujocoRig(replace(settings, noise=()), HERE), commands)[:, :4]
    np.testing.assert_allclose(measured, expected, atol=1e-3 * np.abs(expected).max())


def test_rig___wheel_on_a_spring___moves_as_in_closed_form(folder: Path) -> None:
    # theta'' + 2 d theta' + w^2 theta = u / J from rest, u constant.
    decay, omega = 0.01 / 0.04, np.sqrt(0.5 / 0.02)
    damped = np.sqrt(omega**2 - decay**2)
    time_s = np.arange(400) / 500.0
    turned = np.exp(-decay * time_s) * (
        np.cos(damped * time_s) + decay / damped * np.sin(damped * time_s)
    )
    measured = run(MujocoRig(spring(), folder), np.full((400, 1), 0.1))
    np.testing.assert_allclose(measured[:, 0], 0.1 / 0.5 * (1.0 - turned), atol=4e-4)
    rate = 0.1 / 0.02 * np.exp(-decay * time_s) * np.sin(damped * time_s) / damped
    np.testing.assert_allclose(measured[:, 1], rate, atol=2e-3)


def test_rig___noise___has_its_size_and_is_that_of_its_seed(folder: Path) -> None:
    sizes = np.array([0.01, 0.3])
    rest = np.zeros((4000, 1))
    first = run(MujocoRig(spring(noise=(0.01, 0.3), seed=5), folder), rest)
    np.testing.assert_allclose(first.std(axis=0), sizes, rtol=0.05)
    again = run(MujocoRig(spring(noise=(0.01, 0.3), seed=5), folder), rest)
    assert first.tobytes() == again.tobytes()
    other = run(MujocoRig(spring(noise=(0.01, 0.3), seed=6), folder), rest)
    assert not np.allclose(first, other)


def test_rig___with_a_clock___follows_it_and_leaves_out_what_is_longer_than_a_second(
    folder: Path,
) -> None:
    now_s = [100.0]
    rig = MujocoRig(spring(), folder, clock=lambda: now_s[0])
    assert not rig.has_virtual_time
    rig.open()
    rig.write([0.1])
    times_s = []
    for now_s[0] in (100.0, 100.25, 100.2501, 103.0):
        times_s.append(rig.read().time_s)
    # A step has 0.1 ms.
    np.testing.assert_allclose(times_s, [0.0, 0.25, 0.2501, 1.2501], atol=1.1e-4)


def test_rig___command_between_two_samples___acts_from_its_own_instant(folder: Path) -> None:
    now_s = [0.0]
    rig = MujocoRig(spring(), folder, clock=lambda: now_s[0])
    rig.open()
    now_s[0] = 0.010
    rig.write([1.0])
    now_s[0] = 0.012
    # u t^2 / 2 J after 2 ms, not after 12.
    assert rig.read()[1][0] == pytest.approx(1.0 * 0.002**2 / 0.04, rel=0.1)


def test_rig___safe_stop_and_close___put_the_actuators_at_zero(folder: Path) -> None:
    rig = MujocoRig(spring(), folder)
    rig.open()
    rig.write([1.0])
    arm = rig.arm
    assert arm.data.ctrl[0] == pytest.approx(1.0)
    rig.safe_stop()
    assert arm.data.ctrl[0] == pytest.approx(0.0, abs=1e-12)
    rig.write([1.0])
    rig.close()
    assert arm.data.ctrl[0] == pytest.approx(0.0, abs=1e-12)
    rig.safe_stop()
    with pytest.raises(RigError, match="not open"):
        rig.read()


@pytest.mark.parametrize("commands", [[np.nan], [0.0, 0.0], [np.inf]])
def test_rig___command_that_is_none___is_refused(folder: Path, commands: list[float]) -> None:
    rig = MujocoRig(spring(), folder)
    rig.open()
    with pytest.raises(RigError, match="commands must be 1 finite numbers"):
        rig.write(commands)


def test_rig___that_diverges___says_so(folder: Path) -> None:
    stiff = SPRING.replace('stiffness="0.5" damping="0.01"', 'stiffness="1e6"')
    (folder / "stiff.xml").write_text(stiff.replace("implicitfast", "Euler"))
    rig = MujocoRig(spring(model="stiff.xml", substeps=1), folder)
    rig.open()
    rig.write([1.0])
    with pytest.raises(RigError, match=r"diverged before .* set more substeps"):
        deque((rig.read() for _ in range(1000)), maxlen=0)


def test_urdf___joint_without_actuator_and_sensor___gets_them_by_the_joints_name(
    folder: Path,
) -> None:
    settings = MujocoSettings(
        model="robot.urdf",
        actuators=("motor:axis",),
        sensors=("jointpos:axis", "jointvel:axis"),
        rate_hz=500.0,
        substeps=9,
    )
    measured = run(MujocoRig(settings, folder), np.full((200, 1), 0.1))
    time_s = np.arange(200) / 500.0
    np.testing.assert_allclose(measured[:, 1], 0.1 / 0.02 * time_s, atol=1e-6)
    np.testing.assert_allclose(measured[:, 0], 0.05 / 0.02 * time_s**2, atol=1e-3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"model": "sprig.xml"}, r"model = sprig.xml: there is no file .*thesis_arm, two_link"),
        ({"model": "broken.xml"}, r"^settings.model = broken.xml: .*XML"),
        ({"actuators": ("moter",)}, r"no actuator moter \(nearest: motor\): it has motor"),
        ({"actuators": ("motor:axes",)}, r"no joint axes \(nearest: axis\): it has axis"),
        ({"sensors": ("angel",)}, r"no sensor angel \(nearest: angle\): it has angle, gyro"),
        ({"sensors": ("gyro",)}, r"gyro has 3 entries: name one, gyro\[0\] to gyro\[2\]"),
        ({"sensors": ("gyro[3]",)}, r"gyro has 3 entries"),
        ({"payload_body": "rim", "payload_kg": 1.0}, r"no body rim.*: it has world, wheel"),
    ],
)
def test_model___that_lacks_what_is_named___is_reported_in_a_line(
    folder: Path, changes: dict[str, object], said: str
) -> None:
    (folder / "broken.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(SettingError, match=said) as refused:
        MujocoRig(spring(**changes), folder).open()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["mujoco-thesis", "mujoco-two-link", "mujoco-tip"])
def test_packaged_rig___read_at_rest___is_complete_and_keeps_its_rate(name: str) -> None:
    description = load_rig(name)
    reading = read_at_rest(driven(description, HERE), description, 0.5)
    assert reading.rate_hz == pytest.approx(description.rate_hz)
    noise = np.array(description.settings["noise"])
    np.testing.assert_allclose(reading.raw.std(axis=0), noise, rtol=0.3)


def test_description___with_too_few_sensors___is_refused() -> None:
    text = load_rig("mujoco-thesis").text.replace("hub_angle, ", "").replace("[0.001, ", "[")
    with pytest.raises(SettingError, match=r"sensors has 3 entries, and the rig 4 signals"):
        driven(described(text), HERE)
