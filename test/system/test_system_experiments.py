"""Experiments of the catalogue on live nodes."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner

from flexarm_bags.check import check_bag
from flexarm_bringup.cli import main
from flexarm_core.channels import BOUND_V
from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.models.model_parameters import write_parameter_file
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.recorded_samples import States, declarations
from support.system_graph import ROOT, fill_disk

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

COMMAND = [str(ROOT / "flexarm"), "experiment"]


def run(graph: Graph, folder: Path, *names: str) -> dict[str, Any]:
    """Run experiments in virtual time and return their manifest."""
    process = graph.run([*COMMAND, *names, "--fast", "--seed", "3", "-o", str(folder)])
    assert process.exit_code() == 0, process.printed
    assert graph.survivors() == []
    content: dict[str, Any] = json.loads((folder / "experiments.json").read_text())
    return content


def test_experiments___are_recorded_as_the_tables_say(graph: Graph, tmp_path: Path) -> None:
    first = run(graph, tmp_path / "first", "O_dat5", "R_dat7")

    described = {name: (each["samples"], each["rate_hz"]) for name, each in first.items()}
    assert described == {"O_dat5": (3000, 300), "R_dat7": (3000, 300)}
    assert [first[name]["payload_kg"] for name in first] == [0.0, 0.2]
    assert all(each["lost"] == 0 for each in first.values())

    open_loop = States(tmp_path / "first" / "O_dat5")
    assert np.max(np.abs(open_loop.command_v)) <= 1.0
    controlled = States(tmp_path / "first" / "R_dat7")
    assert controlled.volts[-300:, 0].mean() == pytest.approx(3.0, abs=0.06)

    commanders = {name: declarations(tmp_path / "first" / name) for name in first}
    assert commanders["O_dat5"] == [("/flexarm/experiment", "periodic_random", False)]
    assert [(node, uses) for node, _, uses in commanders["R_dat7"]] == [
        ("/flexarm/controller", True)
    ]

    left = {path.name for path in (tmp_path / "first").iterdir()}
    assert left == {*first, "experiments.json", "nodes.log"}
    assert not check_bag(tmp_path / "first" / "R_dat7").problems


@pytest.mark.exhaustive
def test_experiments___again_over_the_old_ones___repeat_themselves(
    graph: Graph, tmp_path: Path
) -> None:
    names, out = ("R_dat7", "O_dat5"), tmp_path / "out"
    first = run(graph, out, *names)
    sign_of_the_old_one = out / "R_dat7" / "R_dat7_1.mcap"
    sign_of_the_old_one.touch()
    assert run(graph, out, *names, "--overwrite") == first
    assert not sign_of_the_old_one.exists()
    assert not check_bag(out / "R_dat7").problems


@pytest.mark.exhaustive
def test_experiment_on_a_board_that_is_not_there___says_what_the_node_said(
    graph: Graph, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.yaml"
    write_parameter_file(rig, {"rig": "nidaq", "nidaq.device": "Dev7"}, node="/flexarm/daq")

    process = graph.run(
        [*COMMAND, "O_dat5", "--params-file", str(rig), "-o", str(tmp_path / "out")]
    )

    assert process.exit_code() == 1
    last = process.printed.splitlines()[-1]
    assert last.startswith("flexarm: daq refused to activate: not activated: ")
    assert "nidaqmx" in last
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"nodes.log"}


def an_old_bag(folder: Path) -> Path:
    """Make a folder that is not to be lost, and return the file in it."""
    folder.mkdir(parents=True)
    file = folder / "metadata.yaml"
    file.write_text("an old bag")
    return file


def test_experiment_interrupted___keeps_its_part_and_the_old_bag_and_leaves_no_process(
    graph: Graph, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    old = an_old_bag(out / "B_dat9")

    heard: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", heard.append, qos.EVERY)
    process = graph.run([*COMMAND, "B_dat9", "--overwrite", "-o", str(out)])
    graph.wait(lambda: len(heard) > 1500, "samples")
    process.send(signal.SIGINT)

    assert process.exit_code() == 130
    assert graph.survivors() == []
    assert {path.name for path in out.iterdir()} == {"B_dat9", "B_dat9.partial", "nodes.log"}
    assert old.read_text() == "an old bag"
    kept = f"what was recorded is kept in {out / 'B_dat9.partial'}"
    assert process.printed.splitlines()[-2:] == [kept, "flexarm: interrupted"]
    run = States(out / "B_dat9.partial")
    assert run.sequence.tolist() == list(range(1, len(run.sequence) + 1))
    assert len(run.sequence) >= 1200
    turns = np.flatnonzero(np.diff(np.sign(run.command_v[2:])))
    position_v = run.volts[2:, 0]
    assert len(turns) > 1
    # The command that turns is in force from the sample after the one that reached the bound.
    assert np.all(np.abs(position_v[turns]) >= BOUND_V - 0.1)


@pytest.mark.exhaustive
def test_experiment_with_a_sample_unanswered___is_refused_and_kept_apart(
    graph: Graph, tmp_path: Path
) -> None:
    heard_s: list[float] = []
    graph.node.create_subscription(
        ArmState, "state", lambda _: heard_s.append(time.monotonic()), qos.EVERY
    )
    process = graph.run([*COMMAND, "O_dat5", "--fast", "-o", str(tmp_path / "out")])
    graph.wait(lambda: len(heard_s) > 50, "samples")
    (experiment,) = graph.survivors("experiment_node")
    os.kill(experiment, signal.SIGSTOP)
    try:
        graph.wait(lambda: time.monotonic() - heard_s[-1] > 2.0, "the wait for an answer")
        waiting = len(heard_s)
        graph.wait(lambda: len(heard_s) > waiting, "the next sample")
    finally:
        os.kill(experiment, signal.SIGCONT)

    assert process.exit_code() == 1
    refusal = r"^flexarm: \d+ of 3000 samples had no command of their own"
    assert re.search(refusal, process.printed, re.MULTILINE), process.printed
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"O_dat5.partial", "nodes.log"}


@pytest.mark.exhaustive
def test_experiment_whose_recorder_fails___ends_at_once_and_keeps_what_there_is(
    graph: Graph, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    heard: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", heard.append, qos.EVERY)
    process = graph.run([*COMMAND, "C_dat3", "-o", str(out)])
    graph.wait(lambda: len(heard) > 600, "samples")
    (recorder,) = graph.survivors("recorder_node")
    (file,) = (out / "C_dat3.new" / "C_dat3").glob("*.mcap")
    fill_disk(recorder, file)

    assert process.exit_code() == 1
    kept = out / "C_dat3.partial"
    last = process.printed.splitlines()[-1]
    assert last.startswith(f"flexarm: recorder: recording stopped: {kept}: cannot write: File too")
    assert f"flexarm bag repair {kept} -o " in last
    assert len(heard) < 0.9 * experiment("C_dat3").samples
    assert graph.survivors() == []
    assert {path.name for path in out.iterdir()} == {"C_dat3.partial", "nodes.log"}


def test_experiment_overwriting___when_no_node_can_start___leaves_the_old_bag(
    graph: Graph, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    old = an_old_bag(out / "O_dat5")
    (out / "nodes.log").mkdir()

    process = graph.run([*COMMAND, "O_dat5", "--fast", "--overwrite", "-o", str(out)])

    assert process.exit_code() == 1
    assert "nodes.log" in process.printed
    assert old.read_text() == "an old bag"
    assert {path.name for path in out.iterdir()} == {"O_dat5", "nodes.log"}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["X_dat1"], "no experiment 'X_dat1'; there are O_dat1 to O_dat14"),
        (["O_dat1"], "O_dat1 is there already: --overwrite replaces it"),
        (["O_dat3", "O_dat2", "O_dat3"], "O_dat3 is named 2 times: name each experiment once"),
        (["O_dat4", "--overwrite"], "O_dat4.new is there: another run records into it"),
        (["O_dat5"], "experiments.json cannot be read (Unterminated string"),
    ],
)
def test_experiment_that_cannot_be___is_refused_in_one_line(
    tmp_path: Path, arguments: list[str], complaint: str
) -> None:
    for name in ("O_dat1", "O_dat4.new"):
        (tmp_path / name).mkdir()
    (tmp_path / "experiments.json").write_text('{"O_dat1": {"sam')

    done = CliRunner().invoke(main, ["experiment", *arguments, "-o", str(tmp_path)])

    assert done.exit_code == 1
    (line,) = done.output.strip().splitlines()
    assert complaint in line
