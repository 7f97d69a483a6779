from __future__ import annotations

import doctest
import re
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

import pytest

from reproduction.chapter2 import tables
from reproduction.framework import findings
from reproduction.framework.computing import Outcome
from reproduction.framework.document import write_document
from reproduction.framework.findings import Finding, Plot, SideBySide, Subject
from reproduction.framework.verdicts import Judgement, Verdict, elsewhere

if TYPE_CHECKING:
    from pathlib import Path
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
    moved = Outcome(Subject("figure-3-3", "Data matching", (), lambda _: finding), finding)
    write_document([moved], tmp_path, complete=True)
    index = (tmp_path / "index.md").read_text("utf-8").splitlines()
    assert "| figure-3-3 | differs | see elsewhere | The errors are judged in table-3-1b |" in index


@pytest.mark.parametrize("module", [findings, tables])
def test_examples_in_docstrings___give_what_they_say(module: ModuleType) -> None:
    failed, attempted = doctest.testmod(module)
    assert attempted
    assert not failed
