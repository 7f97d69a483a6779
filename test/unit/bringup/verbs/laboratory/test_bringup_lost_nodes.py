from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.graph import processes
from flexarm_bringup.graph.processes import LaunchError, NodeProcesses, NodeProgram
from flexarm_bringup.verbs.laboratory.lost_nodes import LostNodes
from support.live_server import until

if TYPE_CHECKING:
    from pathlib import Path

WORDS = {"controller_node": lambda: "-p law:=pd", "recorder_node": lambda: "-p bag:=NEW_BAG"}
CASES = {
    "controller_node": "the drive goes to zero; for another one: "
    "flexarm run flexarm_control controller_node --ros-args -r __ns:=/arm2 -p law:=pd",
    "recorder_node": "nothing is recorded any more, and the arm goes on; for another one: "
    "flexarm run flexarm_daq recorder_node --ros-args -r __ns:=/arm2 -p bag:=NEW_BAG",
    "experiment_node": "the arm goes on without experiments in open loop; for another one: "
    "flexarm run flexarm_daq experiment_node --ros-args -r __ns:=/arm2",
    "ident_node": "the arm goes on without identification; for another one: "
    "flexarm run flexarm_ident ident_node --ros-args -r __ns:=/arm2",
}


def torn_node(
    monkeypatch: pytest.MonkeyPatch, folder: Path, executable: str
) -> tuple[list[NodeProgram], Path]:
    """Return a node that prints a word and ends, and the log for it."""
    node = folder / executable
    node.write_text("#!/bin/sh\necho torn\nexit 3\n")
    node.chmod(0o755)
    monkeypatch.setattr(processes, "find_executable", lambda *_: node)
    return [NodeProgram("flexarm_daq", executable, {})], folder / "nodes.log"


@pytest.mark.parametrize("executable", CASES)
def test_node_that_no_loop_needs___ends___is_reported_once_and_is_the_error_of_the_end(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    executable: str,
) -> None:
    with NodeProcesses(*torn_node(monkeypatch, tmp_path, executable)) as nodes:
        lost = LostNodes(nodes, "/arm2", WORDS)
        until(lambda: bool(nodes.endings()))
        for _ in range(2):
            lost.look()
        nodes.check()
        with pytest.raises(LaunchError, match=f"^{executable} ended with exit code 3: torn$"):
            lost.check()
    reported = " ".join(capsys.readouterr().out.split())
    assert reported == f"{executable} ended with exit code 3: torn; {CASES[executable]}"


def test_node_of_the_loop___ends___is_the_end_of_all(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with NodeProcesses(*torn_node(monkeypatch, tmp_path, "daq_node")) as nodes:
        lost = LostNodes(nodes, "/arm2", WORDS)
        until(lambda: bool(nodes.endings()))
        lost.look()
        lost.check()
        with pytest.raises(LaunchError, match="daq_node ended with exit code 3"):
            nodes.check()
    assert capsys.readouterr().out == ""


def test_page___ends_after_it_was_served___is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with NodeProcesses(*torn_node(monkeypatch, tmp_path, "live_node")) as nodes:
        nodes.let_be_replaced("live_node")
        until(lambda: bool(nodes.endings()))
        LostNodes(nodes, "/flexarm", WORDS).look()
    reported = " ".join(capsys.readouterr().out.split())
    assert "torn; the arm goes on without it; to have it back, end this up by Ctrl-C" in reported
