from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph import processes
from flexarm_bringup.verbs.laboratory import programs
from flexarm_live.terminal_socket import listen

MANY = "--topics state --topics /diagnostics --max-bag-size 1000000 --max-bag-duration 600"


@pytest.mark.parametrize(
    ("options", "given"),
    [
        ("", []),
        (
            MANY,
            [
                "topics:=['state', '/diagnostics']",
                "max_bagfile_size:=1000000",
                "max_bagfile_duration:=600.0",
            ],
        ),
        ("--snapshot-mode", ["snapshot_mode:=true"]),
    ],
)
def test_record___options___become_parameters_of_the_recorder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, options: str, given: list[str]
) -> None:
    begun: list[list[str]] = []
    monkeypatch.setattr(programs, "_become", begun.append)
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("recorder_node"))

    result = CliRunner().invoke(programs.record, [str(tmp_path / "run"), *options.split()])

    assert result.exit_code == 0, result.output
    (command,) = begun
    told = [word for flag, word in pairwise(command) if flag == "-p"]
    assert told == [f"bag:='{tmp_path / 'run'}'", *given]


def test_record___beside_up___is_a_node_of_another_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    begun: list[list[str]] = []
    monkeypatch.setattr(programs, "_become", begun.append)
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("recorder_node"))
    monkeypatch.setattr("flexarm_core.own_files.gettempdir", lambda: str(tmp_path))

    for _ in range(2):
        CliRunner().invoke(programs.record, ["run", "--namespace", "arm_of_a_test"])
        with listen("/arm_of_a_test"):
            CliRunner().invoke(programs.record, ["run", "--namespace", "arm_of_a_test"])

    named = [[word for word in command if word.startswith("__node:=")] for command in begun]
    assert named == [[], [f"__node:=recorder_{os.getpid()}"]] * 2
