"""Tests of the verb bench."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.bench import bench
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Return the commands that would have run, of which the rig's fails."""
    monkeypatch.setenv("FLEXARM_ROOT", str(PROJECT))
    begun: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        begun.append(command[2:])
        return subprocess.CompletedProcess(command, int(command[2].endswith(".rig")))

    monkeypatch.setattr(subprocess, "run", run)
    return begun


def test_all___runs_every_bench_of_speed_and_says_which_failed(
    commands: list[list[str]], tmp_path: Path
) -> None:
    result = CliRunner().invoke(bench, ["all", "--json", str(tmp_path)])
    assert isinstance(result.exception, LaunchError)
    assert str(result.exception).endswith(": rig")
    modules = [module for module, *_ in commands]
    names = [module.rpartition(".")[2] for module in modules]
    assert names == ["verbs", "bags", "rig", "ident", "loop"]
    for (module, *arguments), name in zip(commands, names, strict=True):
        assert (PROJECT / f"{module.replace('.', '/')}.py").is_file()
        assert arguments[-2:] == ["--json", str(tmp_path / f"{name}.json")]


def test_all___without_a_folder___keeps_no_figures(commands: list[list[str]]) -> None:
    CliRunner().invoke(bench, ["all"])
    assert len(commands) == 5
    assert all("--json" not in command for command in commands)


def test_bench___one___gets_the_arguments(commands: list[list[str]]) -> None:
    assert CliRunner().invoke(bench, ["verbs", "--runs", "2"]).exit_code == 0
    assert commands == [["bench.verbs.verbs", "--runs", "2"]]
