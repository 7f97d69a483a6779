"""Commissioning of twins without nodes: to a controller, within limits, interrupted and resumed."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_bringup.runs.live_arm import answers_to_pulses
from flexarm_bringup.verbs.commissioning.commissioner import Commissioner, State, StateError
from flexarm_bringup.verbs.commissioning.results import write_results
from flexarm_bringup.verbs.offline.servo import write_servo
from flexarm_control import load_controller
from flexarm_control.commissioning.answers import ArmFaultError, soft_loop
from flexarm_control.commissioning.programme import PARTS, Measurement, Programme
from flexarm_control.twin import TwinRig, twin_description
from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described, load_rig
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.experiments.catalogue import experiment, on_rig
from flexarm_ident import identify
from flexarm_ident.models.files import save_model
from support.direct_arm import DirectArm
from support.exhaustive import first_of
from support.kept_limits import passed_limits
from support.servo_plants import bending_arm, two_joints

if TYPE_CHECKING:
    from pathlib import Path

    import control

    from flexarm_bringup.verbs.commissioning.commissioner import Steps
    from flexarm_core.rig_description import RigDescription

STAGES = ["pulses_joint_1", "friction", "friction_faster", "part_1", "hold", "step"]
# Each is interrupted once, in this order.
DEATHS = ["pulses_joint_1", "friction", "part_1", "step", ""]


def twin_rig(folder: Path, model: control.StateSpace) -> RigDescription:
    """Return the description of the twin of a model."""
    ends = {
        "input_low": [-1.0] * model.ninputs,
        "input_high": [1.0] * model.ninputs,
        "output_low": [-1.0] * model.noutputs,
        "output_high": [1.0] * model.noutputs,
        "noise_sd": [1e-3] * model.noutputs,
    }
    save_model(folder / "model.yaml", model, name="arm", provenance=ends)
    return described(twin_description(folder / "model.yaml"))


def commissioned(arm: DirectArm, state: State) -> Steps:
    """Go through all stages."""
    commissioner = Commissioner(arm, arm.rig, state)
    results, design = commissioner.run()
    write_servo(design, [results.name], state.folder / "servo")
    steps = commissioner.step(design)
    write_results(arm.rig, state, results, design, steps)
    return steps


@pytest.mark.slow
def test_unknown_arm___interrupted_in_every_stage___ends_in_its_controller(tmp_path: Path) -> None:
    rig = twin_rig(tmp_path, bending_arm())
    driver = TwinRig("model.yaml", [1e-3, 1e-3], rig=rig, folder=tmp_path)
    runs: list[str] = []
    for dies_in in DEATHS:
        arm = DirectArm(rig, driver, tmp_path)
        arm.dies_in = dies_in
        state = State.of(tmp_path, {"rig": rig.text, "goal": 0.05})
        if dies_in:
            with pytest.raises(KeyboardInterrupt):
                commissioned(arm, state)
        else:
            steps = commissioned(arm, state)
        runs += arm.runs

    # A hold belongs to the step behind it; nothing else was measured twice.
    assert runs == [*STAGES[:5], *STAGES[4:]]
    for name in STAGES:
        assert passed_limits(arm.record(name), rig) == []
    pulse = arm.record("pulses_joint_1").u
    assert np.abs(pulse).max() <= 0.5

    controller = load_controller(tmp_path / "controller.yaml")
    assert (list(controller.inputs), list(controller.tracked)) == (["torque"], ["hub"])
    (found,) = steps.results
    assert abs(found.steady_error) < 0.02
    assert np.abs(steps.arm.y[:, 0] - steps.twin.y[:, 0]).max() < 0.1 * abs(steps.steps[0])
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["servo"]["disk_margin"] >= 0.5
    assert "Step on the arm" in (tmp_path / "report.html").read_text()


def test_best_model_without_a_margin___is_followed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {name: {"bags": [name]} for name in ("part_1", "part_2", "part_3")}
    state = State(tmp_path, {"rig": "", "goal": 0.05}, found)
    rig = twin_rig(tmp_path, bending_arm())
    arm = DirectArm(rig, TwinRig("model.yaml", rig=rig, folder=tmp_path), tmp_path)
    commissioner = Commissioner(arm, rig, state)
    margins: dict[str, float | None] = {"part_3": None, "part_1": 0.4, "part_2": 0.6}

    def designed(_: Commissioner, results: str) -> SimpleNamespace:
        margin = margins[results]
        if margin is None:
            raise SettingError("no stabilising design")
        return SimpleNamespace(gains=SimpleNamespace(disk_margin=margin))

    monkeypatch.setattr(Commissioner, "_identified", lambda _, name, __: name)
    monkeypatch.setattr(Commissioner, "design", designed)
    names = tuple(margins)
    assert str(commissioner.designed(names)[0]) == "part_2"
    margins["part_2"] = 0.3
    assert str(commissioner.designed(names)[0]) == "part_1"
    margins.update(dict.fromkeys(names))
    with pytest.raises(SettingError, match="no stabilising design"):
        commissioner.designed(names)


@pytest.mark.parametrize(
    "model", first_of([bending_arm(dt_s=0.008), two_joints(0.008)]), ids=["one motor", "two motors"]
)
@pytest.mark.slow
def test_closed_loop_experiment___of_an_arm_that_was_pulsed___keeps_its_travel_and_finds_its_model(
    tmp_path: Path, model: control.StateSpace
) -> None:
    rig = twin_rig(tmp_path, model)
    arm = DirectArm(rig, TwinRig(**rig.settings, rig=rig, folder=tmp_path), tmp_path)
    entry = on_rig(experiment("C_dat2"), rig)
    gains = soft_loop(answers_to_pulses(arm, rig), rig)._asdict()
    parameters = replace(entry, gains=gains).commander_parameters(seed=1)
    record = arm.measured(
        Measurement("C_dat2", "controller", parameters, entry.samples / entry.rate_hz)
    )
    angles = [rig.output_names.index(joint.angle) for joint in rig.joints]
    # 3 V of 6.857 V, of a travel of 1.5, and what a damping of 0.4 overshoots by.
    assert np.abs(record.y[:, angles]).max(axis=0).min() > 0.6
    assert np.abs(record.y[:, angles]).max() < 1.5
    found = identify(record, order=4, block_rows=20)
    at = np.exp(2j * np.pi * 1.0 * record.dt_s)
    expected = np.abs(model(at)[angles])
    error = np.abs(np.abs(found.model(at)[angles]) - expected).max()
    # Of two joints with the same square waves it is half of it.
    assert error < 0.02 * expected.max()


@pytest.mark.parametrize("payload_kg", [0.0, 0.4])
@pytest.mark.slow
def test_pulses___of_an_arm_with_a_heavy_tip___are_right_and_show_a_loose_gear(
    tmp_path: Path, payload_kg: float
) -> None:
    rig = load_rig("thesis")
    for play_deg in (RigParameters().backlash_deg, 3.0):
        driver = SimulatedRig(RigParameters(payload_kg=payload_kg, backlash_deg=play_deg), seed=1)
        arm = DirectArm(rig, driver, tmp_path)
        refused = pytest.raises(ArmFaultError, match="loose gear: position_v and speed_v")
        with refused if play_deg == 3.0 else nullcontext():
            answers_to_pulses(arm, rig)
        arm.forget("pulses_hub")


def test_folder_of_another_arm___is_refused(tmp_path: Path) -> None:
    State.of(tmp_path, {"rig": "one", "goal": 0.05}).note("pulses", [])

    assert State.of(tmp_path, {"rig": "one", "goal": 0.05}).found == {"pulses": []}
    with pytest.raises(StateError, match="began with another rig: choose another --out"):
        State.of(tmp_path, {"rig": "two", "goal": 0.05})
    (tmp_path / "commission.json").write_text("{")
    with pytest.raises(StateError, match="cannot be read"):
        State.of(tmp_path, {"rig": "one", "goal": 0.05})


def test_growth___ends_at_the_travel(tmp_path: Path) -> None:
    rig = twin_rig(tmp_path, bending_arm())
    programme = Programme(rig)
    arm = DirectArm(rig, TwinRig("model.yaml", rig=rig, folder=tmp_path), tmp_path)
    record = arm.measured(programme.pulses(0))
    largest = np.abs(record.y[:, 0]).max()

    assert programme.growth(record, 2.0) == pytest.approx(min(2.0, 0.8 * 1.5 / largest))
    assert programme.growth(record, 8.0) == pytest.approx(1.25)


def test_dry_run___says_stages_limits_and_times_and_leaves_nothing(tmp_path: Path) -> None:
    found = CliRunner().invoke(
        main, ["commission", "--rig", "thesis", "--dry-run", "-o", str(tmp_path / "out")]
    )

    assert found.exit_code == 0, found.output
    stages = Programme(load_rig("thesis")).stages()
    for each in stages:
        assert f"{each.length_s:.0f} s" in found.output
    assert "-5 to 5 V" in found.output
    total = sum(each.length_s for each in stages)
    assert f"{total:.0f} s of arm time at most" in found.output
    # Five minutes of arm time are enough.
    assert total <= 300.0
    assert f"up to {PARTS} times" in " ".join(found.output.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("{unit: N m, limits: 1}", "{unit: N m, limits: [-1, 0]}", "rests at 0 N m, an end of its"),
        (
            "joints: {hip: {input: motor, angle: hub, travel: 1}}",
            "joints: {}",
            "has none: name them in its description",
        ),
    ],
)
def test_arm___that_cannot_be_held_in_a_soft_loop___is_refused_before_anything_runs(
    tmp_path: Path, before: str, after: str, said: str
) -> None:
    text = (
        "name: mine\nrate_hz: 100\ninputs: {motor: {unit: N m, limits: 1}}\n"
        "outputs: {hub: {quantity: angle, unit: rad}}\n"
        "joints: {hip: {input: motor, angle: hub, travel: 1}}\ndriver: twin\n"
    )
    assert text.count(before) == 1
    (tmp_path / "mine.yaml").write_text(text.replace(before, after))
    out = str(tmp_path / "out")
    arm = str(tmp_path / "mine.yaml")
    for words in (["commission", "--dry-run"], ["commission"], ["experiment", "C_dat3"]):
        found = CliRunner().invoke(main, [*words, "--rig", arm, "-o", out])
        assert (found.exit_code, found.output.count("\n")) == (1, 1)
        assert said in found.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [[], ["--rig", "thesis", "--twin", __file__]])
def test_no_arm_or_two___are_refused(words: list[str]) -> None:
    found = CliRunner().invoke(main, ["commission", *words])

    assert found.exit_code == 2
    assert "name the arm" in found.output
