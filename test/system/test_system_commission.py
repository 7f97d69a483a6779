"""Commissioning on live nodes, of a twin: killed, gone on with, and refused on a wrong arm."""

from __future__ import annotations

import json
import signal
from typing import TYPE_CHECKING

import pytest

from flexarm_control import load_controller
from flexarm_control.twin import twin_description
from flexarm_core.rig_description import load_rig
from flexarm_ident import read_bag
from flexarm_ident.models.files import save_model
from support.kept_limits import passed_limits
from support.looking_on import looked_on
from support.servo_plants import bending_arm
from support.system_graph import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph, Process

pytestmark = [pytest.mark.system, pytest.mark.slow]

ENDS = {
    "input_low": [-1.0],
    "input_high": [1.0],
    "output_low": [-1.0, -1.0],
    "output_high": [1.0, 1.0],
    "noise_sd": [1e-3, 1e-3],
}


def rig_of(folder: Path) -> Path:
    """Write the twin of an arm that bends, and return its description."""
    save_model(folder / "model.yaml", bending_arm(dt_s=0.008), name="arm", provenance=ENDS)
    file = folder / "rig.yaml"
    file.write_text(twin_description(folder / "model.yaml"))
    return file


def commission(graph: Graph, rig: Path, out: Path, *more: str) -> Process:
    """Start a commissioning in virtual time."""
    command = [str(ROOT / "flexarm"), "commission", "--rig", str(rig), "--fast", "-o", str(out)]
    return graph.run([*command, *more])


def made(out: Path) -> dict[str, int]:
    """Return when each record was made."""
    whole = (out / "bags").glob("*/metadata.yaml")
    return {file.parent.name: file.stat().st_mtime_ns for file in whole}


@pytest.mark.exhaustive
def test_commission___killed___goes_on_to_a_controller(graph: Graph, tmp_path: Path) -> None:
    rig, out = rig_of(tmp_path), tmp_path / "out"
    process = commission(graph, rig, out)
    process.wait_for("Slow motion in a soft position loop")
    process.send(signal.SIGKILL)
    process.exit_code()
    graph.wait(lambda: not graph.survivors(), "the end of the nodes")
    assert (out / "bags" / "pulses_joint_1").is_dir()
    assert not (out / "bags" / "friction").exists()

    measured = made(out)
    process = commission(graph, rig, out, "--live")
    process.wait_for("http://")
    (address,) = (line for line in process.printed.splitlines() if line.startswith("http"))
    hello, shown, _ = looked_on(address)
    assert hello["hand"] is False
    told = {reason for _, reason in shown if reason in process.printed}
    assert any("of the limits on" in each for each in told), told
    assert process.exit_code(1200.0) == 0, process.printed
    assert measured == {name: made(out)[name] for name in measured}
    assert "pulses_joint_1 was measured before" in process.printed
    assert graph.survivors() == []
    for bag in ("pulses_joint_1", "friction", "part_1", "hold", "step"):
        assert passed_limits(read_bag(out / "bags" / bag), load_rig(str(rig))) == []
    assert list(load_controller(out / "controller.yaml").tracked) == ["hub"]
    summary = json.loads((out / "summary.json").read_text())
    assert abs(summary["step"][0]["arm"]["steady_error"]) < 0.02
    assert (out / "report.html").is_file()


@pytest.mark.exhaustive
def test_commission_of_a_reversed_arm___is_refused_before_the_excitation(
    graph: Graph, tmp_path: Path
) -> None:
    rig, out = rig_of(tmp_path), tmp_path / "out"
    rig.write_text(rig.read_text().replace("travel: 1.5", "travel: 1.5\n    sign: -1"))
    process = commission(graph, rig, out)

    assert process.exit_code() == 1
    assert "flexarm: reversed wiring: a positive torque turns hub" in process.printed
    assert [path.name for path in (out / "bags").iterdir() if path.is_dir()] == ["pulses_joint_1"]
