from __future__ import annotations

import math
import operator
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.console import terminal
from reproduction import __main__ as program
from reproduction.framework.findings import Call, Finding, SideBySide, Subject
from reproduction.framework.verdicts import Verdict, exactly, judged
from support.project import PROJECT
from support.system_graph import FIRST_WORD

if TYPE_CHECKING:
    from pathlib import Path

    from click.testing import Result

    from reproduction.framework.findings import Results

ROOT, WRONG = Call(math.sqrt, (9.0,)), Call(operator.truediv, (1, 0))


def _built(results: Results) -> Finding:
    judgement = judged(
        statements=(exactly("the root is four", holds=results[ROOT] == 4.0),),
        evidence="ours is [3].",
        reason="Because.",
    )
    return Finding(judgement, (SideBySide("Roots", ("thesis", "ours"), (("[4]", "3"),)),))


SUBJECTS = (
    Subject("table-2-1", "A root [of nine]", (ROOT,), _built),
    Subject("table-2-2", "Never", (WRONG,), _built),
)


@pytest.fixture(autouse=True)
def _two_subjects(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(program, "all_subjects", lambda: SUBJECTS)


def flexarm(*arguments: str) -> Result:
    return CliRunner().invoke(program.main, ["reproduce", "--jobs", "1", *arguments])


def test_reproduce___subject___is_written_and_its_results_are_kept(tmp_path: Path) -> None:
    result = flexarm("table-2-1", "-o", "pages")
    assert result.exit_code == 0, result.output
    page = (tmp_path / "pages" / "chapter-2.md").read_text("utf-8")
    assert Verdict.DIFFERS.value in page
    assert "Because." in page
    assert len(list((tmp_path / program.CACHE).iterdir())) == 1


def test_reproduce___anew___computes_what_is_kept(tmp_path: Path) -> None:
    def kept() -> int:
        (file,) = (tmp_path / program.CACHE).iterdir()
        return file.stat().st_ino

    flexarm("table-2-1")
    first = kept()
    flexarm("table-2-1")
    assert kept() == first
    flexarm("table-2-1", "--anew")
    assert kept() != first


@pytest.mark.parametrize("name", ["index.md", "chapter-2.md"])
def test_reproduce___page_of_somebody_else___is_refused_before_the_work(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_text("mine")
    refused = flexarm("table-2-1", "-o", ".")
    assert refused.exit_code == 1
    assert f"{name}: was not written by flexarm" in refused.output
    assert not (tmp_path / program.CACHE).exists()
    assert (tmp_path / name).read_text() == "mine"
    for more in (["--force"], []):
        assert flexarm("table-2-1", "-o", ".", *more).exit_code == 0
    assert "Because." in (tmp_path / "chapter-2.md").read_text("utf-8")


def test_reproduce___finding___is_shown_with_both_figures_and_the_verdict() -> None:
    with terminal.CONSOLE.capture() as captured:
        result = flexarm("table-2-1")
    assert result.exit_code == 0
    text = captured.get()
    for words in (
        "A root [of nine]",
        "Roots",
        "[4]",
        "ours is [3]. Because.",
        "differs 1",
    ):
        assert words in text


def test_reproduce___failed_computation___exits_with_one_and_says_why() -> None:
    with terminal.CONSOLE.capture() as captured:
        result = flexarm("all")
    assert result.exit_code == 1
    assert "ZeroDivisionError" in captured.get()
    assert "differs 1" in captured.get()


def test_reproduce___interrupt___exits_with_130_and_says_that_it_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(program, "reproduce", interrupted)
    with terminal.CONSOLE.capture() as captured:
        result = flexarm("all")
    assert result.exit_code == 130
    assert "goes on from there" in captured.get()


def test_reproduce___list___names_what_is_meant_and_runs_nothing(tmp_path: Path) -> None:
    with terminal.CONSOLE.capture() as captured:
        result = flexarm("--list", "table-2-1")
    assert result.exit_code == 0
    assert "A root [of nine]" in captured.get()
    assert "table-2-2" not in captured.get()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [((), 2, "--list"), (("tabel-2-1",), 1, "did you mean table-2-1"), (("--jobs", "0"), 2, "0")],
)
def test_reproduce___wrong_words___are_refused_in_a_line(
    arguments: tuple[str, ...], code: int, words: str
) -> None:
    result = flexarm(*arguments)
    assert result.exit_code == code
    assert words in result.output


def verb_of(folder: Path, *arguments: str, root: Path | None = PROJECT) -> subprocess.Popen[str]:
    """Start the verb in a process of its own, as the command does."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    environment.pop("FLEXARM_ROOT", None)
    if root is not None:
        environment["FLEXARM_ROOT"] = str(root)
    return subprocess.Popen(  # noqa: S603 - our own command
        [sys.executable, "-c", "from flexarm_bringup.cli import main; main()", *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_verb___program_of_the_checkout___gives_its_lines_and_its_exit_code(tmp_path: Path) -> None:
    with verb_of(tmp_path, "reproduce", "tabel-2-1") as running:
        output, _ = running.communicate()
    assert running.returncode == 1
    assert "did you mean table-2-1" in output
    assert FIRST_WORD.sub("", output).count("\n") == 1


def test_verb___outside_a_checkout___says_so_in_a_line(tmp_path: Path) -> None:
    with verb_of(tmp_path, "reproduce", "--list", root=None) as running:
        output, _ = running.communicate()
    assert running.returncode == 1
    assert "live in the checkout" in output
    assert FIRST_WORD.sub("", output).count("\n") == 1


@pytest.mark.slow
@pytest.mark.exhaustive
def test_verb___interrupt___reaches_the_program(tmp_path: Path) -> None:
    with verb_of(tmp_path, "reproduce", "table-2-1", "--jobs", "1") as running:
        assert running.stdout is not None
        for line in running.stdout:
            if "computing" in line:
                break
        running.send_signal(signal.SIGINT)
        output, _ = running.communicate()
    assert running.returncode == 130
    assert "goes on from there" in output
