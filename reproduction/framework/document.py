"""Pages of the findings: Markdown with pictures, an index and one page per chapter."""

from __future__ import annotations

import html
import re
from typing import TYPE_CHECKING

from flexarm_core.outputs import MARK
from reproduction.framework.findings import Subject, Verdict, count
from reproduction.framework.selection import APPENDICES, page_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from reproduction.framework.computing import Outcome
    from reproduction.framework.findings import Finding, SideBySide, Subject

INDEX = "index.md"
PICTURES = "svg"
_HEAD = f"<!-- {MARK} -->\n"
_INTRODUCTION = """\
Each table, figure and claim of the thesis *System Identification and Control of a Flexible
Manipulator* beside what flexarm gives for it, with a verdict. Nothing here was written by hand:
`./flexarm reproduce all -o docs/reproduction` runs the experiments on the simulated rig,
identifies, reduces, tunes and controls as the thesis does, and writes these pages. The same seeds
give the same pages.

- **agrees**: the figures lie within the tolerance that the subject states.
- **agrees by construction**: so do these, and they could hardly do otherwise, because rig or method
  was built by the thesis's words; counted apart.
- **same ranking**: the figures differ, and what the thesis concludes from their order holds.
- **differs**: with the reason.
- **our choice**: no subject of the thesis, but what it leaves open and we had to choose.
"""
# Counts of the edition of these pages before the rules became stricter: by its own rules, and by
# the present ones as far as its figures tell. In the order of `Verdict`.
_EARLIER = {
    "earlier edition, by its rules": (45, 0, 33, 17, 0),
    "earlier edition, by these rules": (28, 8, 42, 17, 0),
}
_STRICTER = """\

The rules became stricter since the earlier edition: tables and figures of reduced models are judged
by their errors too, not by their cost alone; what agrees by construction is counted apart; the laws
of all PI models are compensated alike; the sums of Table 4-2 are judged; ILQR is judged with the
thesis's weights too. And models are identified in the thesis's way now, which matches our records
less well than ours: see choice 2-2."""
_TITLES = {"chapter": "Chapter {}", APPENDICES: "Appendices"}
_MARKS = {
    Verdict.AGREES: "✔",
    Verdict.BY_CONSTRUCTION: "=",
    Verdict.SAME_RANKING: "≈",
    Verdict.DIFFERS: "✘",
    Verdict.OURS: "·",
}
_PICTURE_WIDTH = 560
_OURS = re.compile(r"(table|figure|claim|appendix|choice)-[a-z0-9-]+-\d+\.svg")


def pages_of(subjects: Sequence[Subject], folder: Path) -> list[Path]:
    """Return the pages that `write_document` writes for subjects."""
    pages = dict.fromkeys(page_of(subject.key) for subject in subjects)
    return [folder / INDEX, *(folder / f"{page}.md" for page in pages)]


def write_document(outcomes: Sequence[Outcome], folder: Path, *, complete: bool) -> None:
    """Write the pages and the pictures; the same findings give the same bytes.

    Parameters
    ----------
    outcomes : sequence of Outcome
        Outcomes of the subjects, in the order of the thesis; failed ones are left out.
    folder : Path
        Folder of ``index.md``, a page per chapter and the folder ``svg``.
    complete : bool
        Remove pictures of earlier runs, as these are all subjects.
    """
    pictures = folder / PICTURES
    pictures.mkdir(parents=True, exist_ok=True)
    done = [(each.subject, each.finding) for each in outcomes if each.finding is not None]
    names = set()
    for subject, finding in done:
        for number, plot in enumerate(finding.plots, start=1):
            name = _picture(subject, number)
            names.add(name)
            (pictures / name).write_text(_on_white(plot.svg), "utf-8")
    pages: dict[str, list[tuple[Subject, Finding]]] = {}
    for subject, finding in done:
        pages.setdefault(page_of(subject.key), []).append((subject, finding))
    for page, part in pages.items():
        sections = "\n".join(line for each in part for line in _section(*each))
        (folder / f"{page}.md").write_text(f"{_HEAD}# {_title(page)}\n{sections}\n", "utf-8")
    (folder / INDEX).write_text(_HEAD + "\n".join(_index(pages)) + "\n", "utf-8")
    if complete:
        for old in pictures.iterdir():
            if _OURS.fullmatch(old.name) and old.name not in names:
                old.unlink()


def _index(pages: dict[str, list[tuple[Subject, Finding]]]) -> Iterator[str]:
    yield "# The thesis, reproduced\n"
    yield _INTRODUCTION
    yield from _table(("", *(f"{_MARKS[kind]} {kind.value}" for kind in Verdict)), _counts(pages))
    yield _STRICTER
    for page, part in pages.items():
        yield f"\n## {_title(page)}\n"
        rows = (
            (f"[{subject.key}]({page}.md#{subject.key})", _escaped(subject.title), _mark(finding))
            for subject, finding in part
        )
        yield from _table(("", "what it shows", "verdict"), rows)


def _counts(pages: dict[str, list[tuple[Subject, Finding]]]) -> Iterator[tuple[str, ...]]:
    parts = {f"[{_title(page)}]({page}.md)": part for page, part in pages.items()}
    everything = [each for part in pages.values() for each in part]
    for title, part in (*parts.items(), ("all", everything)):
        found = count([finding.judgement for _, finding in part])
        yield title, *(str(found[kind]) for kind in Verdict)
    for title, counts in _EARLIER.items():
        yield title, *map(str, counts)


def _section(subject: Subject, finding: Finding) -> Iterator[str]:
    kind, _, number = subject.key.partition("-")
    number = "-".join(part.upper() if len(part) == 1 else part for part in number.split("-"))
    yield f'\n<a id="{subject.key}"></a>\n'
    yield f"## {kind.capitalize()} {number}: {_escaped(subject.title)}\n"
    yield f"{_mark(finding)}: {_escaped(finding.judgement.because)}"
    for paragraph in finding.text:
        yield f"\n{paragraph}"
    for table in finding.tables:
        yield f"\n**{_escaped(table.title)}**\n"
        yield from _side_by_side(table)
    for plot_number, plot in enumerate(finding.plots, start=1):
        source = f"{PICTURES}/{_picture(subject, plot_number)}"
        words = html.escape(" ".join(plot.caption.split()))
        yield f'\n<img src="{source}" alt="{words}" width="{_PICTURE_WIDTH}">\n'
        yield f"*{_escaped(plot.caption)}*"


def _side_by_side(table: SideBySide) -> Iterator[str]:
    yield from _table(
        tuple(map(_escaped, table.headings)), (tuple(map(_escaped, row)) for row in table.rows)
    )


def _table(headings: Sequence[str], rows: Iterator[tuple[str, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(headings)} |"
    yield f"|{' --- |' * len(headings)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def _mark(finding: Finding) -> str:
    verdict = finding.judgement.verdict
    return f"{_MARKS[verdict]} **{verdict.value}**"


def _escaped(text: str) -> str:
    """Return text that stands in Markdown for itself, in one line."""
    text = " ".join(text.split()).replace("&", "&amp;").replace("<", "&lt;")
    return re.sub(r"([\\|*~\[\]])", r"\\\1", text)


def _title(page: str) -> str:
    name, _, number = page.partition("-")
    return _TITLES[name].format(number)


def _picture(subject: Subject, number: int) -> str:
    return f"{subject.key}-{number}.svg"


def _on_white(svg: str) -> str:
    """Return a picture that can be seen on a dark page too."""
    return svg.replace("<svg ", '<svg style="background:white" ', 1) + "\n"
