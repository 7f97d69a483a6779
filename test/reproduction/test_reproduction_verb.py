from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.checkout import reproduce as verb
from flexarm_bringup.cli import main
from flexarm_bringup.console import terminal
from flexarm_reproduction.findings import Finding, SideBySide, Verdict, judged
from flexarm_reproduction.subjects import Call, Subject

if TYPE_CHECKING:
    from pathlib import Path

    from click.testing import Result

    from flexarm_reproduction.subjects import Results

ROOT, WRONG = Call(math.sqrt, (9.0,)), Call(operator.truediv, (1, 0))


def _built(results: Results) -> Finding:
    judgement = judged(
        agrees=results[ROOT] == 4.0,
        same_ranking=False,
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
    monkeypatch.setattr(verb, "all_subjects", lambda: SUBJECTS)


def flexarm(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["reproduce", "--jobs", "1", *arguments])


def test_reproduce___subject___is_written_and_its_results_are_kept(tmp_path: Path) -> None:
    result = flexarm("table-2-1", "-o", "pages")
    assert result.exit_code == 0, result.output
    page = (tmp_path / "pages" / "chapter-2.md").read_text("utf-8")
    assert Verdict.DIFFERS.value in page
    assert "Because." in page
    assert len(list((tmp_path / verb.CACHE).iterdir())) == 1


def test_reproduce___finding___is_shown_with_both_figures_and_the_verdict() -> None:
    with terminal.CONSOLE.capture() as captured:
        result = flexarm("table-2-1")
    assert result.exit_code == 0
    text = captured.get()
    for words in (
        "A root [of nine]",
        "Roots",
        "[4]",
        "differs: ours is [3]. Because.",
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

    monkeypatch.setattr(verb, "reproduce", interrupted)
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
