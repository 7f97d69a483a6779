from __future__ import annotations

import doctest
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import yaml

from reproduction.chapter2 import tables
from reproduction.framework import document, findings
from reproduction.framework.computing import Outcome
from reproduction.framework.document import write_document
from reproduction.framework.findings import Finding, Plot, SideBySide, Subject
from reproduction.framework.verdicts import (
    Beside,
    Judgement,
    Statement,
    Verdict,
    elsewhere,
    judged,
)

if TYPE_CHECKING:
    from types import ModuleType

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><path d="M0 0"/></svg>'
AWKWARD = "a|b <i> 7~9,11~13 *x* \\ & [y]\nz"


def outcome(key: str, verdict: Verdict = Verdict.AGREES, plots: int = 0) -> Outcome:
    finding = Finding(
        Judgement(verdict, f"because of {AWKWARD}"),
        tables=(SideBySide("Both", ("thesis", "ours | here"), ((AWKWARD, "1"), ("2", "3"))),),
        plots=[Plot(f'curve "{k}" <b>', SVG) for k in range(plots)],
        text=("What was *done*.",),
    )
    return of(key, finding)


def of(key: str, finding: Finding) -> Outcome:
    return Outcome(Subject(key, f"Title | of {key}", (), lambda _: finding), finding)


OUTCOMES = (
    outcome("table-2-1", Verdict.AGREES, 2),
    outcome("claim-2-1", Verdict.DIFFERS),
    outcome("figure-3-1", Verdict.SAME_CONCLUSIONS, 1),
    outcome("appendix-b"),
)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def cells(line: str) -> list[str]:
    """Split a row as Markdown does: at the bars without a backslash."""
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def test_write_document___same_findings___same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_document(OUTCOMES, tmp_path / name, complete=True)
    write_document(OUTCOMES, tmp_path / "two", complete=True)
    one = contents(tmp_path / "one")
    assert one == contents(tmp_path / "two")
    assert set(one) == {
        "index.md",
        "chapter-2.md",
        "chapter-3.md",
        "appendices.md",
        "svg/table-2-1-1.svg",
        "svg/table-2-1-2.svg",
        "svg/figure-3-1-1.svg",
    }


def test_write_document___index___counts_the_verdicts_and_links_to_every_section(
    tmp_path: Path,
) -> None:
    write_document(OUTCOMES, tmp_path, complete=True)
    index = (tmp_path / "index.md").read_text("utf-8")
    rows = [cells(line) for line in index.splitlines() if line.startswith("|")]
    assert ["[Chapter 2](chapter-2.md)", *"10001000"] in rows
    assert ["all", *"20101000"] in rows
    links = re.findall(r"^\| \[\S+\]\((\S+?\.md)#(\S+?)\)", index, re.MULTILINE)
    assert [anchor for _, anchor in links] == [each.subject.key for each in OUTCOMES]
    for page, anchor in links:
        assert f'<a id="{anchor}"></a>' in (tmp_path / page).read_text("utf-8")


def test_write_document___index___says_the_parts_of_each_subject_and_of_each_page(
    tmp_path: Path,
) -> None:
    thesis = (1.0, 2.0, 4.0, 8.0)
    near, far, level = (
        Beside("errors", thesis, thesis),
        Beside("errors", thesis, (1.0, 9.0, 9.0, 9.0)),
        Beside("errors", (3.0, 3.1), (3.1, 3.0)),
    )
    holds, is_open, is_reversed = (
        Statement(words, *chances)
        for words, chances in (("a", (0.01, 1.0)), ("b", (0.5, 0.5)), ("c", (1.0, 0.01)))
    )
    parts: dict[str, tuple[list[Beside], list[Statement]]] = {
        "table-2-1": ([near, far], [holds, is_open]),
        "claim-2-1": ([level], [holds, is_open, is_reversed]),
        # As in the earlier edition.
        "claim-2-7": ([], [is_reversed]),
    }
    outcomes = [
        of(key, Finding(judged(figures=figures, statements=statements)))
        for key, (figures, statements) in parts.items()
    ]
    write_document(outcomes, tmp_path, complete=True)
    index = (tmp_path / "index.md").read_text("utf-8")
    rows = [cells(line) for line in index.splitlines() if line.startswith("|")]
    shown = {row[0].partition("]")[0][1:]: row[2:4] for row in rows if len(row) == 5}
    assert shown["table-2-1"] == ["4 of 4; 2 of 4", "1 of 2"]
    assert shown["claim-2-1"] == ["2 of 2, no nearer than a constant", "1 of 3, 1 reversed"]
    assert ["all", "1 of 3 kinds", "2", "2", "2"] in rows
    moved = {row[0]: row[1:] for row in rows if len(row) == 4}
    assert moved["claim-2-1"][-1].endswith("conclusions: 1 of 3, 1 reversed (b; c)")
    assert moved["choice-2-1"][1] == "left out"
    assert moved["table-2-1"][:2] == ["differs", "partly"]
    assert "claim-2-7" not in moved


def test_write_document___earlier_edition___is_counted_whole(tmp_path: Path) -> None:
    write_document(OUTCOMES, tmp_path, complete=True)
    rows = map(cells, (tmp_path / "index.md").read_text("utf-8").splitlines())
    (earlier,) = (row for row in rows if row and row[0].startswith("earlier edition"))
    kinds = yaml.safe_load((Path(document.__file__).with_name("earlier.yaml")).read_text("utf-8"))
    assert sum(map(int, earlier[1:])) == sum(map(len, kinds.values()))
    counts = dict(zip(Verdict, map(int, earlier[1:]), strict=True))
    assert counts[Verdict.SAME_CONCLUSIONS] == len(kinds["same ranking"])
    assert counts[Verdict.DIFFERS] == len(kinds["differs"])


def test_write_document___awkward_text___stays_in_its_cell(tmp_path: Path) -> None:
    write_document(OUTCOMES, tmp_path, complete=True)
    page = (tmp_path / "appendices.md").read_text("utf-8")
    rows = [cells(line) for line in page.splitlines() if line.startswith("|")]
    assert [len(row) for row in rows] == [2, 2, 2, 2]
    assert rows[0] == ["thesis", r"ours \| here"]
    assert rows[2][1] == "1"
    # No tag, no emphasis, no link and nothing struck through.
    assert "<i>" not in page
    assert not re.search(r"(?<!\\)[~\[]", rows[2][0])
    assert not re.search(r"(?<!\\)\*x", rows[2][0])
    assert "What was *done*." in page


def test_write_document___pictures___are_there_and_can_be_read(tmp_path: Path) -> None:
    write_document(OUTCOMES, tmp_path, complete=True)
    page = (tmp_path / "chapter-2.md").read_text("utf-8")
    tags = [ET.fromstring(tag.replace(">", "/>")) for tag in re.findall(r"<img .*>", page)]  # noqa: S314 - our own
    assert [tag.attrib["alt"] for tag in tags] == ['curve "0" <b>', 'curve "1" <b>']
    for tag in tags:
        root = ET.fromstring((tmp_path / tag.attrib["src"]).read_text("utf-8"))  # noqa: S314 - our own
        assert root.tag.endswith("svg")
        assert "white" in root.attrib["style"]


@pytest.mark.parametrize("complete", [True, False])
def test_write_document___old_pictures___go_only_when_everything_was_asked_for(
    tmp_path: Path, *, complete: bool
) -> None:
    write_document(OUTCOMES, tmp_path, complete=True)
    foreign = tmp_path / "svg" / "logo.svg"
    foreign.write_text(SVG)
    write_document(OUTCOMES[1:], tmp_path, complete=complete)
    left = {path.name for path in (tmp_path / "svg").iterdir()}
    old = set() if complete else {"table-2-1-1.svg", "table-2-1-2.svg"}
    assert left == {"logo.svg", "figure-3-1-1.svg"} | old


def test_write_document___failed_subject___is_left_out(tmp_path: Path) -> None:
    failed = Outcome(OUTCOMES[0].subject, None, "ValueError: no")
    write_document((failed, *OUTCOMES[1:]), tmp_path, complete=True)
    assert "table-2-1" not in (tmp_path / "chapter-2.md").read_text("utf-8")
    assert "chapter-2.md#table-2-1" not in (tmp_path / "index.md").read_text("utf-8")


def test_write_document___verdict_that_another_subject_has___keeps_its_name(tmp_path: Path) -> None:
    finding = Finding(elsewhere("table-3-1b", "Nothing runs away. The errors are judged in"))
    write_document([of("figure-3-3", finding)], tmp_path, complete=True)
    index = (tmp_path / "index.md").read_text("utf-8").splitlines()
    assert "| figure-3-3 | differs | see elsewhere | The errors are judged in table-3-1b |" in index


@pytest.mark.parametrize("module", [findings, tables])
def test_examples_in_docstrings___give_what_they_say(module: ModuleType) -> None:
    failed, attempted = doctest.testmod(module)
    assert attempted
    assert not failed
