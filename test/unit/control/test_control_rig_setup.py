"""Laws and servo in the loop of a rig with two joints: a twin of a known model behind the gate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_control.loop_setup import PARAMETERS, parameters_in
from flexarm_control.models.nominal_models import identified_model
from flexarm_control.rig_setup import RigSetup, first_references, recorded_setup
from flexarm_control.servo.files import save_controller
from flexarm_control.servo.job import ServoRequest, Source, design_servo
from flexarm_control.twin import TwinRig, twin_description
from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described, load_rig
from flexarm_core.signals import Sample
from flexarm_daq.loop.limiter import rig_gate
from flexarm_ident.models.files import save_model
from support.servo_plants import two_joints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.rig_setup import Loop
    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription

TRAVEL = {"output_low": [-2.0] * 2, "output_high": [2.0] * 2}
ENDS = {"input_low": [-1.0] * 2, "input_high": [1.0] * 2}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> RigDescription:
    """Return the twin of two joints of 1 N m, a motor each."""
    file = tmp_path_factory.mktemp("twin") / "model.yaml"
    save_model(file, two_joints(), name="joints", provenance={**TRAVEL, **ENDS})
    return described(twin_description(file))


def parameters(**changes: Any) -> dict[str, Any]:  # noqa: ANN401 - values of any type
    return {spec.name: spec.default for spec in PARAMETERS} | changes


def run(
    rig: RigDescription, loop: Loop, references: Sequence[tuple[float, ...]], cut: float = np.inf
) -> tuple[FloatArray, FloatArray, list[Sample]]:
    """Run a loop on the twin, with commands cut to a size; return outputs, efforts and samples."""
    plant = TwinRig(**rig.settings, rig=rig, folder=Path())
    gate = rig_gate(rig)
    plant.open()
    loop.reset()
    samples, efforts = [], []
    in_force: tuple[float, ...] = (0.0, 0.0)
    compensations: tuple[float, ...] = (0.0, 0.0)
    for k, wanted in enumerate(references):
        outputs = plant.read().outputs
        samples.append(Sample(k, k + 1, tuple(outputs.tolist()), in_force, compensations, k))
        answer = loop.step(samples[-1], wanted)
        limited = gate.apply(*answer, outputs.tolist(), 1.0 / rig.rate_hz)
        in_force = tuple(min(max(each, -cut), cut) for each in limited.commands)
        compensations = limited.compensations
        plant.write(in_force)
        efforts.append(answer[0])
    return np.array([each.outputs for each in samples]), np.array(efforts), samples


def test_description___of_a_model___has_a_joint_for_each_motor(rig: RigDescription) -> None:
    assert [(each.input, each.angle) for each in rig.joints] == [
        ("torque1", "hub1"),
        ("torque2", "hub2"),
    ]
    assert [(each.low, each.high) for each in rig.joints] == [(-3.0, 3.0)] * 2
    assert [(each.low, each.high) for each in rig.inputs] == [(-1.0, 1.0)] * 2


@pytest.mark.slow
def test_pd___moves_each_joint_to_its_set_point(rig: RigDescription) -> None:
    setup = RigSetup.of(parameters(law="pd"), rig)
    wanted = (0.6, -0.4)
    y, u, _ = run(rig, setup.loop(), [wanted] * round(20 * rig.rate_hz))
    places = [rig.output_names.index(each.output) for each in setup.tracks]
    np.testing.assert_allclose(y[-1, places], wanted, atol=0.02)
    assert np.abs(u).max() <= 1.0


def test_references___before_one_was_given___are_where_the_arm_is(rig: RigDescription) -> None:
    setup = RigSetup.of(parameters(law="pd"), rig)
    outputs = [0.0] * len(rig.outputs)
    for track, value in zip(setup.tracks, (0.3, 9.0), strict=True):
        outputs[rig.output_names.index(track.output)] = value
    sample = Sample(0, 1, tuple(outputs), (0.0, 0.0), (0.0, 0.0), 0)
    # Within the travel.
    assert first_references(setup, sample) == (0.3, 3.0)


@pytest.mark.parametrize("law", ["pdpc", "ilqr", "planned", "lqg"])
def test_law___that_needs_more_than_angles_and_rates___is_refused(
    rig: RigDescription, law: str
) -> None:
    with pytest.raises(SettingError, match=f"law {law} needs .*take pd or pi"):
        RigSetup.of(parameters(law=law), rig)


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a servo for both joints."""
    request = ServoRequest(("hub1", "hub2"), {"torque1": 1.0, "torque2": 1.0}, bandwidth_hz=2.0)
    file = tmp_path_factory.mktemp("servo") / "controller.yaml"
    save_controller(file, design_servo([Source("joints", two_joints())], request).gains)
    return file


@pytest.fixture
def servo(rig: RigDescription, controller: Path) -> RigSetup:
    """Return the setup of that servo."""
    values = parameters(law="servo", **{"servo.controller": str(controller)})
    return RigSetup.of(values, rig)


@pytest.mark.slow
def test_servo___moves_both_joints_without_overshoot(rig: RigDescription, servo: RigSetup) -> None:
    assert [each.name for each in servo.tracks] == ["joint_1", "joint_2"]
    y, _, _ = run(rig, servo.loop(), [(0.0, 0.0)] + [(0.5, -0.3)] * round(6 * rig.rate_hz))
    places = [rig.output_names.index(each.output) for each in servo.tracks]
    np.testing.assert_allclose(y[-1, places], (0.5, -0.3), atol=0.01)
    assert y[:, places[0]].max() < 0.5 * 1.05


@pytest.mark.slow
def test_servo___hears_commands_that_were_cut(rig: RigDescription, servo: RigSetup) -> None:
    """A filter that does not hear a limit takes it for a disturbance, and the arm overshoots."""
    references = [(0.0, 0.0)] + [(1.0, 0.0)] * round(12 * rig.rate_hz)
    y, u, _ = run(rig, servo.loop(), references, cut=0.1)
    place = rig.output_names.index(servo.tracks[0].output)
    assert np.abs(u[:, 0]).max() > 0.1
    np.testing.assert_allclose(y[-1, place], 1.0, atol=0.02)


def test_servo___of_other_signals___is_refused(rig: RigDescription, controller: Path) -> None:
    other = described(rig.text.replace("torque2", "torque3"))
    with pytest.raises(SettingError, match=r"has the input torque2, and rig .* torque3"):
        RigSetup.of(parameters(law="servo", **{"servo.controller": str(controller)}), other)


def test_set_points___that_the_law_does_not_track___are_refused(
    rig: RigDescription, controller: Path
) -> None:
    one = described(rig.text.replace("driver:", "tracked: [hub2]\ndriver:"))
    with pytest.raises(SettingError, match=r"law pd turns the joints .* tracks hub2: take the law"):
        RigSetup.of(parameters(law="pd"), one)
    with pytest.raises(SettingError, match=r"write tracked: \[hub1, hub2\] into its file"):
        RigSetup.of(parameters(law="servo", **{"servo.controller": str(controller)}), one)


def test_servo___that_tracks_no_angle_of_a_joint___has_its_set_point(
    rig: RigDescription, tmp_path: Path
) -> None:
    text = rig.text[: rig.text.index("joints:")] + rig.text[rig.text.index("driver:") :]
    free = described(text.replace("unit: rad}", "unit: rad, range: 2}") + "tracked: [hub1, hub2]\n")
    request = ServoRequest(("hub1", "hub2"), {"torque1": 1.0, "torque2": 1.0}, bandwidth_hz=2.0)
    file = tmp_path / "controller.yaml"
    save_controller(file, design_servo([Source("joints", two_joints())], request).gains)
    setup = RigSetup.of(parameters(law="servo", **{"servo.controller": str(file)}), free)
    assert [(each.name, each.low, each.high) for each in setup.tracks] == [
        ("hub1", -2.0, 2.0),
        ("hub2", -2.0, 2.0),
    ]
    y, _, _ = run(free, setup.loop(), [(0.0, 0.0)] + [(0.5, -0.3)] * round(6 * free.rate_hz))
    np.testing.assert_allclose(y[-1], (0.5, -0.3), atol=0.01)


def test_servo___without_a_file___is_refused(rig: RigDescription) -> None:
    with pytest.raises(SettingError, match=r"law servo needs servo\.controller"):
        RigSetup.of(parameters(law="servo"), rig)


@pytest.mark.parametrize("law", ["pd", "pi", "servo"])
def test_loop___from_its_recorded_text_and_memory___gives_the_same_commands(
    rig: RigDescription, controller: Path, law: str
) -> None:
    values = parameters(law=law, **{"servo.controller": str(controller)})
    setup = RigSetup.of(values, rig)
    loop = setup.loop()
    middle = 400
    _, efforts, samples = run(rig, loop, [(0.4, -0.2)] * (2 * middle))
    loop.reset()
    for sample in samples[:middle]:
        loop.step(sample, (0.4, -0.2))
    reported = json.loads(json.dumps({name: list(each) for name, each in loop.memory().items()}))
    again = recorded_setup(parameters_in(setup.text)).loop()
    again.remember(reported)
    replayed = [again.step(sample, (0.4, -0.2))[0] for sample in samples[middle:]]
    assert np.array(replayed).tobytes() == efforts[middle:].tobytes()


def test_controller___that_is_replaced___leaves_no_jump(
    rig: RigDescription, servo: RigSetup, controller: Path
) -> None:
    other = RigSetup.of(parameters(law="servo", **{"servo.controller": str(controller)}), rig)
    loop = servo.loop()
    _, efforts, samples = run(rig, loop, [(0.0, 0.0)] + [(0.5, -0.3)] * 60)
    before = np.array(efforts[-1])
    assert np.abs(before).max() > 0.01
    loop.replace(other.laws)
    last = samples[-1]._replace(commands=tuple(before.tolist()))
    np.testing.assert_allclose(loop.step(last, (0.5, -0.3))[0], before, atol=1e-12)


def test_record___of_a_servo_on_the_thesis_arm___says_what_a_replay_needs(tmp_path: Path) -> None:
    """Its text names the rig, so that the set-points stand in the memory, as on every other rig."""
    request = ServoRequest(("position_v",), {"command_v": 10.0}, bandwidth_hz=1.0)
    file = tmp_path / "controller.yaml"
    save_controller(file, design_servo([Source("arm", identified_model())], request).gains)
    arm = load_rig("thesis")
    setups = [
        RigSetup.of(parameters(law="servo", **{"servo.controller": str(file)}), arm),
        RigSetup.of(parameters(law="pdpc"), arm),
    ]
    reported = [setup.recorded_memory(setup.loop(), (0.5,)) for setup in setups]
    assert [memory.get("references") for memory in reported] == [(0.5,), None]
    assert ["rig" in json.loads(setup.text) for setup in setups] == [True, False]
    # The record of the servo is read as one of a rig.
    again = recorded_setup(parameters_in(setups[0].text))
    again.loop().remember(reported[0])
    assert again.text == setups[0].text
