"""The verb learn in one process: runs, files, and the table."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.simulated.learn import learn
from flexarm_control.learning.columns import read_trajectory
from flexarm_core.outputs import OutputError

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.slow
def test_learning___from_nothing_in_one_process___writes_a_command_that_is_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "flexarm_bringup.verbs.simulated.node_run", raising=False)
    monkeypatch.setitem(sys.modules, "rclpy.parameter", None)
    reference, out = tmp_path / "reference.csv", tmp_path / "out"
    reference.write_text("time_s,reference_v\n0,0\n0.2,1.5\n1,1.5\n")
    words = ["--reference", str(reference), "--repetitions", "2", "--from-nothing", "--fast"]

    ran = CliRunner().invoke(learn, [*words, "--out", str(out)], catch_exceptions=False)

    assert ran.exit_code == 0
    summary = json.loads((out / "summary.json").read_text())
    kept = summary["kept"]
    assert len(summary["repetitions"]) == 3
    assert kept >= 1
    assert summary["ratio"] <= 0.3
    trajectory = read_trajectory(out / "trajectory.csv")
    assert trajectory.end_v == pytest.approx(1.5, abs=1e-6)
    assert "Kept motion" in (out / "report.html").read_text()
    assert not (out / "bag").exists()
    assert f"trajectory={out / 'trajectory.csv'}" in ran.output.replace("\n", "")


def test_learning___beside_a_trajectory_of_somebody_else___is_refused(tmp_path: Path) -> None:
    (tmp_path / "trajectory.csv").write_text("mine")

    refused = CliRunner().invoke(learn, ["--reference", "any.csv", "--out", str(tmp_path)])

    assert isinstance(refused.exception, OutputError)
    assert "trajectory.csv" in str(refused.exception)
