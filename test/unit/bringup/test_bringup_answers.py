"""Answers of the script `flexarm` from files, beside those of click."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
from typing import TYPE_CHECKING

import pytest
from click.shell_completion import get_completion_class

from flexarm_bringup import answers
from flexarm_bringup.cli import main
from flexarm_bringup.console.verb_group import LazyVerbGroup
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

_NO_PROGRAM = 127
"""Exit code of bash without the program, which has to answer what no file does."""
_VERBS = ("completion", "catalogue", "bag", "set", "exec", "identify", "up")
_GROUP = LazyVerbGroup(
    name="flexarm",
    groups={"All": {verb: main.places[verb] for verb in _VERBS}},
    context_settings=main.context_settings,
    help="Title.",
)


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("install")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        answers.write(folder / ".flexarm-answers", _GROUP)
    return folder


def script(install: Path, *words: str, **settings: str) -> subprocess.CompletedProcess[str]:
    inside = {"FLEXARM_ROOT": str(PROJECT), "FLEXARM_INSTALL": str(install)}
    return subprocess.run(  # noqa: S603 - our own script
        [PROJECT / "flexarm", *words],
        env={"PATH": "/usr/bin:/bin", **inside, **settings},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def test_files___of_two_calls_at_once___are_those_of_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / ".flexarm-answers"
    monkeypatch.setattr(os, "getpid", itertools.count(1).__next__)
    remove = shutil.rmtree

    def beside(old: Path, *, ignore_errors: bool) -> None:
        """Remove what is old, and let another call end before this one."""
        remove(old, ignore_errors=ignore_errors)
        monkeypatch.setattr(shutil, "rmtree", remove)
        answers.write(folder, _GROUP)

    monkeypatch.setattr(shutil, "rmtree", beside)
    answers.write(folder, _GROUP)
    assert [each.name for each in tmp_path.iterdir()] == [folder.name]
    assert (folder / "80" / "up").is_file()


@pytest.mark.parametrize("words", [(), ("identify",), ("bag", "check"), ("exec",)], ids=" ".join)
@pytest.mark.parametrize("columns", [80, 100, 120, 200])
def test_help___is_that_of_click(
    install: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    columns: int,
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    _GROUP.main([*words, "--help"], prog_name="flexarm", standalone_mode=False)
    answered = script(install, *words, "-h", COLUMNS=str(columns))
    assert answered.stdout == capsys.readouterr().out
    assert len(answered.stdout.splitlines()) > 1


def test_help_between_two_widths___is_the_narrower(install: Path) -> None:
    found = [script(install, "up", "-h", COLUMNS=str(width)).stdout for width in (119, 100, 120)]
    assert found[0] == found[1] != found[2]


@pytest.mark.parametrize(
    ("line", "number"),
    [
        ("flexarm", 1),
        ("flexarm co", 1),
        ("flexarm identify --me", 2),
        ("flexarm identify bags --me", 3),
        ("flexarm catalogue O_dat1", 2),
        ("flexarm set controller la", 3),
        ("flexarm set d", 2),
        ("flexarm up --law pd", 3),
    ],
)
@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion___is_that_of_click(
    install: Path, monkeypatch: pytest.MonkeyPatch, shell: str, line: str, number: int
) -> None:
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(number)}
    for name, value in asked.items():
        monkeypatch.setenv(name, value)
    kind = get_completion_class(shell)
    assert kind is not None
    wanted = kind(_GROUP, {}, "flexarm", "_FLEXARM_COMPLETE").complete()
    answered = script(install, _FLEXARM_COMPLETE=f"{shell}_complete", **asked)
    assert answered.stdout == f"{wanted}\n"
    assert wanted


@pytest.mark.parametrize(
    ("line", "number"),
    [
        ("flexarm identify ba", 2),
        ("flexarm identify --output --me", 3),
        ("flexarm bag check --", 3),
        ("flexarm identify 'a b' --me", 4),
        ("flexarm nothing", 1),
        ("flexarm ../bash/up --law", 2),
        ("flexarm", 0),
    ],
)
def test_line_that_depends_on_its_place___is_left_to_python(
    install: Path, line: str, number: int
) -> None:
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(number)}
    done = script(install, _FLEXARM_COMPLETE="bash_complete", **asked)
    assert (done.returncode, done.stdout) == (_NO_PROGRAM, "")


@pytest.mark.parametrize(
    "words",
    [("up", "--rig", "x", "-h"), ("exec", "python", "-h"), ("../80/up", "-h"), ("up",), ("-hh",)],
    ids=" ".join,
)
def test_words_of_no_file___are_left_to_python(install: Path, words: tuple[str, ...]) -> None:
    assert script(install, *words, COLUMNS="80").returncode == _NO_PROGRAM


def test_help_that_is_older_than_a_source___is_left_to_python_until_it_is_written(
    install: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = install / ".flexarm-answers"
    file = folder / "80" / "up"
    before = file.read_text()
    os.utime(file, (0.0, 0.0))
    assert script(install, "up", "-h", COLUMNS="80").returncode == _NO_PROGRAM
    monkeypatch.setenv("COLUMNS", "80")
    answers.write_verb(folder, _GROUP, "up")
    assert script(install, "up", "-h", COLUMNS="80").stdout == before


def test_name_in_the_examples___is_how_the_script_was_called(tmp_path: Path) -> None:
    file = tmp_path / ".flexarm-answers" / "80" / "up"
    file.parent.mkdir(parents=True)
    file.write_text(f"{answers.NAME} up\n\n  {answers.NAME} up --law pdpc\n")
    reported = script(tmp_path, "up", "--help", FLEXARM_CALLED="a/b & c/flexarm")
    assert reported.stdout == "a/b & c/flexarm up\n\n  a/b & c/flexarm up --law pdpc\n"
    assert script(tmp_path, "up", "--help").stdout == "flexarm up\n\n  flexarm up --law pdpc\n"
