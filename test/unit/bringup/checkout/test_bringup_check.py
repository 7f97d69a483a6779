from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.checkout.check import check_everything
from flexarm_bringup.verbs.checkout import test as verb

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """Return the commands that would have run in a checkout, the second of which fails."""
    (tmp_path / "pyproject.toml").touch()
    monkeypatch.setenv("FLEXARM_ROOT", str(tmp_path))
    begun: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[bytes]:
        begun.append(command[2:])
        return subprocess.CompletedProcess(command, int(len(begun) == 2))

    monkeypatch.setattr(subprocess, "run", run)
    return begun


def test_quick___runs_no_slow_and_no_system_test(
    commands: list[list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert check_everything((), quick=True) == 1
    assert [tool for tool, *_ in commands] == ["ruff", "ruff", "mypy", "pytest"]
    assert commands[-1][-3:] == ["-m", "not slow", "test/unit"]
    told = capsys.readouterr().out
    assert "left out: tests marked slow" in told
    assert "failed: format" in told


def test_all___runs_unit_and_system_tests(commands: list[list[str]]) -> None:
    check_everything(())
    assert [command[-1] for command in commands[-2:]] == ["test/system", "test/system"]
    assert "--ignore" in commands[-2]


def test_arguments___go_to_pytest_alone(commands: list[list[str]]) -> None:
    assert check_everything(("test/unit", "-k", "margins")) == 0
    assert commands == [["pytest", "test/unit", "-k", "margins"]]


def test_quick___with_arguments___is_refused() -> None:
    result = CliRunner().invoke(verb, ["--quick", "test/unit"])
    assert result.exit_code == 2
    assert "--quick chooses the tests" in result.output
