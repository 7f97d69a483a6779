"""From an experiment to a controlled step, for a payload that has no packaged model."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from rclpy.parameter import Parameter

from flexarm_bringup.cli import main
from flexarm_bringup.verbs.simulated import design
from flexarm_bringup.verbs.simulated.one_process import one_process
from flexarm_control import step_figures
from flexarm_daq import RigParameters
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident import read_bag
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.models.state_space import state_space
from flexarm_msgs.srv import Identify, Tune
from support.system_graph import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

PAYLOAD_KG = 0.15
SET_POINT_V = 3.0


@pytest.mark.slow
@pytest.mark.exhaustive
def test_experiment___identified_and_designed_on___is_controlled_in_the_running_controller(
    graph: Graph, tmp_path: Path
) -> None:
    for name in ("recorder", "ident", "tuner"):
        graph.start(name, {"output_folder": str(tmp_path / "models")} if name == "ident" else {})
    experiment = {"law": "pd", "pd.compensation_v": 0.7, "reference": "varying_square"}
    graph.start("controller", experiment)
    rig = {"payload_kg": PAYLOAD_KG, "seed": 3, "time": "virtual", "real_time_factor": 0.0}
    graph.start("daq", rig)
    graph.configure_loop()
    graph.operator.await_recorder()
    run = graph.operator.recorded_run
    run("controller", str(tmp_path / "experiment"), 6000, lambda _: None)
    asked = Identify.Request(
        bag_uris=[str(tmp_path / "experiment")],
        block_rows=20,
        remove_compensation=True,
        stabilise=True,
    )
    identified = graph.call(Identify, "identify", asked)
    assert identified.success, identified.message
    model = {each.name: Parameter.from_parameter_msg(each).value for each in identified.parameters}
    file = str(tmp_path / "models" / "experiment" / "model.yaml")

    tuned = graph.call(Tune, "tune", Tune.Request(law="ilqr", models=[file]))
    assert tuned.success, tuned.message
    weights = {each.name: Parameter.from_parameter_msg(each).value for each in tuned.parameters}
    chosen = {"law": "ilqr", "reference": "step", "step.amplitude_v": SET_POINT_V}
    assert weights["ilqr.model"] == "experiment"
    own = {name: value for name, value in weights.items() if not name.startswith("models.")}
    assert graph.refusal("controller", {**model, **own, **chosen}) == ""
    run("controller", str(tmp_path / "step"), 1500, lambda _: None)

    step = read_bag(tmp_path / "step")
    figures = step_figures(step.dt_s * np.arange(len(step)), step.y[:, 0], SET_POINT_V)
    assert abs(figures.mean_error_v) <= 0.05
    assert figures.overshoot <= 0.1

    foreign = state_space(
        np.diag([0.9, 0.8]), np.ones((2, 1)), np.eye(2), 0.0, 0.01, outputs=["angle", "current"]
    )
    parameters = dict(model_parameters("foreign", foreign, provenance={}))
    reason = graph.refusal("controller", {**parameters, "ilqr.model": "foreign"})
    assert "inputs: 1, outputs: 2" in reason


@pytest.mark.slow
@pytest.mark.exhaustive
def test_design___of_a_payload_that_nobody_packaged___holds_its_step(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The nodes give the same samples, as the test of the demo shows, at some times the cost.
    monkeypatch.setattr(design, "simulated_run", one_process)
    out = tmp_path / "design"
    words = ["design", "--payload", str(PAYLOAD_KG), "--law", "pdp", "--fast", "--out", str(out)]

    verb = CliRunner().invoke(main, words)

    assert verb.exit_code == 0, verb.output
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["payload_kg"], summary["law"]) == (PAYLOAD_KG, "pdp")
    true_hz = natural_frequencies_hz(RigParameters(payload_kg=PAYLOAD_KG))
    nearest = [min(summary["modes_hz"], key=lambda hz: abs(hz - each)) for each in true_hz[:2]]
    np.testing.assert_allclose(nearest, true_hz[:2], rtol=0.15)
    assert summary["margins"]["gain_db"] >= 9.9
    assert summary["margins"]["phase_deg"] >= 54.9
    step = summary["step"]
    assert abs(step["mean_error_v"]) <= 0.05
    assert step["overshoot"] <= 0.1
    assert step["settling_s"] is not None
    assert set(summary["packaged"]["step"]) == set(step)
    assert summary["packaged"]["margins"].keys() == summary["margins"].keys()
    gain_db, phase_deg = (summary["margins"][key] for key in ("gain_db", "phase_deg"))
    assert f"; margins {gain_db:.1f} dB, {phase_deg:.0f} deg" in " ".join(verb.output.split())
    report = (out / "report.html").read_text()
    assert "Designed step" in report
    assert "Packaged step" in report
    assert "complementary sensitivity" in report
    # What was designed is what a controller takes.
    graph.start(
        "controller",
        {"law": "pdpc"},
        "--params-file",
        str(out / "controller.yaml"),
    )
    assert graph.transition("controller", "configure")
    assert not (out / "bag").exists()


def test_design___of_a_law_that_cannot_be_designed___is_refused_in_one_line(
    graph: Graph, tmp_path: Path
) -> None:
    words = ["design", "--law", "pd", "--out", str(tmp_path / "design")]

    verb = graph.run([str(ROOT / "flexarm"), *words])

    assert verb.exit_code() != 0
    assert "Traceback" not in verb.printed
    assert "'ilqr', 'lqg', 'pdp'" in verb.printed
