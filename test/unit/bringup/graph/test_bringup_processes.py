from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
import yaml

from flexarm_bringup.graph import processes
from flexarm_bringup.graph.processes import LaunchError, NodeProcesses, NodeProgram


@pytest.mark.parametrize(
    ("value", "read"),
    [
        (Path("/a b/it's"), "/a b/it's"),
        ("1e3", "1e3"),
        (True, True),
        (0.5, 0.5),
        (3, 3),
        (["state", "command"], ["state", "command"]),
    ],
)
def test_node_program___parameter___is_read_back_as_given(
    monkeypatch: pytest.MonkeyPatch, value: object, read: object
) -> None:
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("/bin/node"))
    program = NodeProgram("flexarm_daq", "player_node", {"bag": value}, namespace="/arm2")
    *start, assignment = program.command()
    enclave = ["--enclave", "/arm2/player"]
    assert start == ["/bin/node", "--ros-args", "-r", "__ns:=/arm2", *enclave, "-p"]
    name, _, text = assignment.partition(":=")
    assert name == "bag"
    assert yaml.safe_load(text) == read


def test_node_program___of_several_nodes___gives_each_its_parameters_before_those_of_ros(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("/bin/node"))
    own = {"daq.seed": 3, "controller.law": "pd"}
    program = NodeProgram("flexarm_bringup", "loop_node", own, has_several=True)
    assert program.command() == [
        "/bin/node",
        "daq.seed:=3",
        "controller.law:='pd'",
        *("--ros-args", "-r", "__ns:=/flexarm", "--enclave", "/flexarm/loop"),
    ]


def rig_node(
    monkeypatch: pytest.MonkeyPatch, folder: Path, printed: list[str]
) -> tuple[list[NodeProgram], Path]:
    """Return a node that prints something and ends with 3, and the log for it."""
    return made_node(monkeypatch, folder, *(f"echo '{line}'" for line in printed), "exit 3")


def made_node(
    monkeypatch: pytest.MonkeyPatch, folder: Path, *lines: str
) -> tuple[list[NodeProgram], Path]:
    """Return a node of these lines of a shell, and the log for it."""
    node = folder / "rig_node"
    node.write_text("\n".join(["#!/bin/bash", *lines, ""]))
    node.chmod(0o755)
    monkeypatch.setattr(processes, "find_executable", lambda *_: node)
    return [NodeProgram("any", "rig_node", {})], folder / "nodes.log"


def check_until_it_ends(nodes: NodeProcesses) -> None:
    deadline_s = time.monotonic() + 60.0
    while time.monotonic() < deadline_s:
        nodes.check()
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("printed", "quoted"),
    [
        ([], "it printed nothing"),
        (
            ["[INFO] [1.5] [flexarm.daq]: ready", "[ERROR] [2.5] [flexarm.rig]: torn"],
            "[ERROR] [2.5] [flexarm.rig]: torn",
        ),
        (["[INFO] [1.5] [flexarm.daq]: ready", "ValueError: torn"], "ValueError: torn"),
        (
            [
                "Traceback (most recent call last):",
                '  File "/a/nodes/daq.py", line 12, in <module>',
                '  File "/a/rigs/mine.py", line 7',
                "    def read(self)",
                "                  ^",
                "SyntaxError: expected a colon",
            ],
            "SyntaxError: expected a colon (/a/rigs/mine.py, line 7)",
        ),
        (["[ERROR] [1.5] [flexarm.rig]: torn", "[INFO] [2.5] [flexarm.daq]: at zero"], ""),
        (["rig: port 80 is taken", "[INFO] [2.5] [flexarm.daq]: at zero"], "rig: port 80 is taken"),
    ],
    ids=["nothing", "its_own", "a_traceback", "an_unreadable_file", "another_node", "no_start"],
)
def test_node_that_ended___last_line___is_quoted_unless_another_node_logged_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, printed: list[str], quoted: str
) -> None:
    with (
        NodeProcesses(*rig_node(monkeypatch, tmp_path, printed)) as nodes,
        pytest.raises(LaunchError) as error,
    ):
        check_until_it_ends(nodes)
    said, ended = str(error.value), "rig_node ended with exit code 3"
    assert said.startswith(f"{ended}: {quoted}" if quoted else ended)
    assert quoted or said == ended


def test_node_that_may_be_replaced___ends___is_reported_and_no_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with NodeProcesses(*rig_node(monkeypatch, tmp_path, ["torn"])) as nodes:
        nodes.let_be_replaced("rig_node")
        deadline_s = time.monotonic() + 60.0
        while not nodes.endings() and time.monotonic() < deadline_s:
            nodes.check()
            time.sleep(0.01)
        nodes.check()
        assert nodes.endings() == {"rig_node": "rig_node ended with exit code 3: torn"}


def test_complaint___is_the_last_error_of_that_node_in_this_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    printed = ["[ERROR] [1.5] [flexarm.rig]: torn", "[ERROR] [2.5] [flexarm.rig]: bent"]
    programs, log = rig_node(monkeypatch, tmp_path, printed)
    log.write_text("[ERROR] [0.5] [flexarm.daq]: of an older run\n")
    with NodeProcesses(programs, log) as nodes:
        with pytest.raises(LaunchError):
            check_until_it_ends(nodes)
        assert (nodes.complaint("rig"), nodes.complaint("daq")) == ("bent", "")


def test_node_that_printed_nothing___is_not_given_the_words_of_an_older_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    programs, log = rig_node(monkeypatch, tmp_path, [])
    log.write_text("[ERROR] [0.5] [flexarm.rig]: of an older run\n")
    with (
        NodeProcesses(programs, log) as nodes,
        pytest.raises(LaunchError, match=r"exit code 3: it printed nothing"),
    ):
        check_until_it_ends(nodes)


def test_node_that_is_stopped_in_its_start___leaves_no_traceback(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    programs, log = rig_node(monkeypatch, tmp_path, [])
    node = tmp_path / "rig_node"
    imports = "import time\nprint('importing', flush=True)\ntime.sleep(60)\n"
    node.write_text(f"#!{sys.executable}\n{imports}")
    with NodeProcesses(programs, log):
        deadline_s = time.monotonic() + 60.0
        while not log.read_text() and time.monotonic() < deadline_s:
            time.sleep(0.01)
    assert log.read_text() == "importing\n"


def test_nodes___start_at_once___and_join_when_they_are_let_in(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    lines = "echo loads", "read -r -n 1 opened <&$FLEXARM_GATE", "echo joins", "sleep 60"
    programs, log = made_node(monkeypatch, tmp_path, *lines)

    def printed(line: str, count: int) -> bool:
        deadline_s = time.monotonic() + 60.0
        while log.read_text().count(line) < count and time.monotonic() < deadline_s:
            time.sleep(0.01)
        return log.read_text().count(line) == count

    with NodeProcesses([*programs, *programs], log) as nodes:
        assert printed("loads", 2)
        assert "joins" not in log.read_text()
        nodes.let_in()
        assert printed("joins", 2)


def test_nodes___stopped_before_they_are_let_in___join_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    joining = "read -r -n 1 opened <&$FLEXARM_GATE && echo joins"
    with NodeProcesses(*made_node(monkeypatch, tmp_path, joining)) as nodes:
        pass
    assert "joins" not in nodes.log.read_text()
    assert set(nodes.exit_codes().values()) != {None}


def test_nodes___that_ended_before_they_are_let_in___are_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with NodeProcesses(*rig_node(monkeypatch, tmp_path, ["torn"])) as nodes:
        with pytest.raises(LaunchError, match="rig_node ended with exit code 3: torn"):
            check_until_it_ends(nodes)
        nodes.let_in()
