from __future__ import annotations

import json
import signal
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.simulated.demo import demo as demo_verb
from flexarm_daq import RigParameters
from flexarm_daq.rigs.beam import natural_frequencies_hz
from support.exhaustive import first_of
from support.looking_on import looked_on
from support.system_graph import ROOT, eventually

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

KEYS = {
    "modes_hz",
    "true_modes_hz",
    "dmv",
    "dmv_mean",
    "sfv_mean",
    "samples",
    "sha256_of_samples",
    "real_time_factor",
    "lost",
    "missed_periods",
    "pdpc",
    "planned",
    "versions",
    "seed",
}
DEMO = [str(ROOT / "flexarm"), "demo", "--fast"]


def check_figures(out: Path) -> None:
    """Refuse a demo with the payload 0.4 kg and the seed 5 that is not as good as it was."""
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary) >= KEYS
    assert (summary["samples"], summary["lost"], summary["seed"]) == (12_000, 0, 5)
    true_hz = natural_frequencies_hz(RigParameters(payload_kg=0.4))
    np.testing.assert_allclose(summary["true_modes_hz"], true_hz)
    first, second, *_ = np.abs(np.array(summary["modes_hz"]) / true_hz - 1.0)
    assert first <= 0.15
    assert second <= 0.08
    assert summary["dmv_mean"] < 0.45
    assert summary["dmv_mean"] == pytest.approx(np.mean(summary["dmv"]))
    pdpc = summary["pdpc"]
    assert abs(pdpc["mean_error_v"]) <= 0.05
    assert pdpc["overshoot"] <= 0.08
    assert pdpc["settling_s"] is not None
    planned = summary["planned"]
    assert abs(planned["mean_error_v"]) <= 0.05
    assert planned["overshoot"] <= 0.06
    assert planned["settling_s"] <= min(1.0, 0.7 * pdpc["settling_s"])
    assert "Controlled step" in (out / "report.html").read_text()
    assert not (out / "bag").exists()


def test_demo___without_nodes___meets_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "flexarm_bringup.verbs.simulated.node_run", raising=False)
    monkeypatch.setitem(sys.modules, "rclpy.parameter", None)
    words = ["--fast", "--payload", "0.4", "--seed", "5", "--out", str(tmp_path / "demo")]
    assert CliRunner().invoke(demo_verb, words).exit_code == 0
    check_figures(tmp_path / "demo")


@pytest.mark.exhaustive
def test_demo___meets_its_figures_and_leaves_only_results(graph: Graph, tmp_path: Path) -> None:
    out = tmp_path / "demo"

    demo = graph.run([*DEMO, "--live", "--payload", "0.4", "--seed", "5", "--out", str(out)])
    demo.wait_for("http://")
    (address,) = (line for line in demo.printed.splitlines() if line.startswith("http"))
    hello, shown, samples = looked_on(address)

    assert demo.exit_code() == 0, demo.printed
    assert hello["hand"] is False
    assert samples > 0
    reported = [
        each for each in dict.fromkeys(reason for _, reason in shown) if each in demo.printed
    ]
    assert [each.split()[0] for each in reported] == [
        "Closed-loop",
        "Identifying",
        "Controlling",
        "Moving",
    ]
    assert ("OFF", reported[1]) in shown
    check_figures(out)
    assert "Traceback" not in (out / "nodes.log").read_text()
    assert graph.survivors() == []


@pytest.mark.parametrize("moment", first_of(["Starting the nodes", "Identifying"]))
def test_demo___interrupted___leaves_no_process_and_no_bag(
    graph: Graph, tmp_path: Path, moment: str
) -> None:
    out = tmp_path / "demo"
    demo = graph.run([*DEMO, "--out", str(out)])
    demo.wait_for(moment)

    demo.send(signal.SIGINT)

    assert demo.exit_code() == 130, demo.printed
    assert demo.printed.endswith("flexarm: interrupted\n")
    assert "Traceback" not in demo.printed
    assert graph.survivors() == []
    assert not (out / "bag").exists()
    assert not (out / "summary.json").exists()


def test_killed_demo___takes_its_nodes_with_it(graph: Graph, tmp_path: Path) -> None:
    demo = graph.run([*DEMO, "--out", str(tmp_path / "demo")])
    demo.wait_for("exciting the arm")
    assert len(graph.survivors()) > 1

    demo.send(signal.SIGKILL)

    assert demo.exit_code() == -signal.SIGKILL
    eventually(lambda: graph.survivors() == [], "the end of the nodes")
