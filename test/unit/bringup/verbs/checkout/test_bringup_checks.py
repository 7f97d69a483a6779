from __future__ import annotations

import os
import subprocess
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.checkout import checks
from flexarm_bringup.verbs.checkout.checks import checks_of
from flexarm_bringup.verbs.checkout.checks import test as verb

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """Return the commands that would have run in a checkout, of which that of the format fails."""
    (tmp_path / "pyproject.toml").touch()
    monkeypatch.setenv("FLEXARM_ROOT", str(tmp_path))
    begun: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        begun.append(command[2:])
        return subprocess.CompletedProcess(command, int("format" in command), stdout="said\n")

    monkeypatch.setattr(subprocess, "run", run)
    # As on a Python that checks types.
    monkeypatch.setattr(checks, "_TYPED_FROM", (3, 10))
    return begun


def test_quick___runs_no_slow_and_no_system_test(commands: list[list[str]]) -> None:
    result = CliRunner().invoke(verb, ["--quick"])
    assert result.exit_code == 1
    tools = [tool for tool, *_ in commands]
    assert sorted(tools[:3]) == ["mypy", "ruff", "ruff"]
    assert tools[3:] == ["pytest"]
    assert result.output.count("said") == 3
    chosen = ["-m", "not slow and not exhaustive", "test/unit", "test/architecture"]
    assert commands[-1][-4:] == chosen
    assert "left out: tests marked slow" in result.output
    assert "failed: format" in result.output


@pytest.mark.parametrize(
    ("option", "chosen"),
    [([], ["-m", "not exhaustive"]), (["--exhaustive"], ["--hypothesis-profile", "exhaustive"])],
)
def test_all___runs_unit_and_system_tests(
    commands: list[list[str]], option: list[str], chosen: list[str]
) -> None:
    CliRunner().invoke(verb, option)
    # What the tests of a file share is computed once; no folder is left out.
    workers = str((os.cpu_count() or 1) + 1)
    by_file = ["--dist", "loadfile", "--no-loadscope-reorder"]
    assert commands[-1] == ["pytest", "-n", workers, *by_file, *chosen]


def test_all___runs_the_examples_of_docstrings_and_pages(commands: list[list[str]]) -> None:
    CliRunner().invoke(verb, [])
    assert any("--doctest-modules" in command for command in commands)


def test_arguments___go_to_pytest_alone(commands: list[list[str]]) -> None:
    assert CliRunner().invoke(verb, ["test/unit", "-k", "margins"]).exit_code == 0
    assert commands == [["pytest", "test/unit", "-k", "margins"]]


@pytest.mark.parametrize("arguments", [[], ["--quick"], ["test/unit"]])
def test_tools___where_python_shall_leave_no_bytecode___leave_it_for_one_another(
    monkeypatch: pytest.MonkeyPatch, commands: list[list[str]], arguments: list[str]
) -> None:
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    said: list[dict[str, str]] = []
    run = subprocess.run

    def note(
        command: list[str], env: dict[str, str] | None = None, **_: object
    ) -> subprocess.CompletedProcess[bytes]:
        said.append(dict(os.environ) if env is None else env)
        return run(command)

    monkeypatch.setattr(subprocess, "run", note)
    CliRunner().invoke(verb, arguments)
    assert len(said) == len(commands) > 0
    for environment in said:
        assert "PYTHONDONTWRITEBYTECODE" not in environment
        assert environment["PATH"] == os.environ["PATH"]


def test_quick___with_arguments___is_refused() -> None:
    result = CliRunner().invoke(verb, ["--quick", "test/unit"])
    assert result.exit_code == 2
    assert "--quick chooses the tests" in result.output


@pytest.mark.parametrize("other", ["--quick", "test/unit"])
def test_exhaustive___with_another_choice___is_refused(other: str) -> None:
    result = CliRunner().invoke(verb, ["--exhaustive", other])
    assert result.exit_code == 2
    assert f"--exhaustive runs every test: leave it out, or leave out {other}" in result.output


@pytest.mark.parametrize(
    ("version", "typed"), [((3, 10), False), ((3, 11), True), ((3, 12), True), ((3, 14), True)]
)
def test_checks_of__python___leaves_types_out_where_numpy_is_old(
    version: tuple[int, int], *, typed: bool
) -> None:
    tools, left_out = checks_of(version)
    names = [name for name, _ in tools]
    assert ("types" in names) is typed
    assert ("types" in left_out) is not typed
    assert [name for name in names if name != "types"] == ["lint", "format", "examples"]
