"""Pages of the findings: Markdown with pictures, an index and one page per chapter."""

from __future__ import annotations

import html
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from flexarm_core.outputs import MARK
from reproduction.framework.findings import Subject
from reproduction.framework.selection import APPENDICES, SENSITIVITY, page_of
from reproduction.framework.verdicts import Verdict, count

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from reproduction.framework.computing import Outcome
    from reproduction.framework.findings import Finding, SideBySide, Subject
    from reproduction.framework.verdicts import Judgement

INDEX = "index.md"
PICTURES = "svg"
_HEAD = f"<!-- {MARK} -->\n"
_INTRODUCTION = """\
Each table, figure and claim of the thesis *System Identification and Control of a Flexible
Manipulator* beside what flexarm gives for it, with a verdict. `./flexarm reproduce all -o
docs/reproduction` runs the experiments on the simulated rig, identifies, reduces, tunes and
controls as the thesis does, and writes these pages: figures, tests and verdicts are computed, the
sentences around them stand in `reproduction/texts`. The same seeds give the same pages. Terms stand
in the [glossary](../glossary.md#the-thesis).

Each subject is judged in up to three parts. Its *figures* agree when nine in ten lie within a
stated band (of fewer than ten, all), and when they are nearer to the thesis's than the best
constant would be, the one number that comes nearest to all of them. Its *conclusions* are
statements of the thesis's text, or the order that a table gives its rows. Each has a test at 5 %:
it holds, or its opposite does and it is reversed, or it stays open; so does a statement about
several records or cases of which some hold and some are reversed. What is impossible as it is
printed, or not printed at all, is *not comparable*. From the parts follows the verdict:

- **agrees**: all figures agree and all conclusions hold.
- **agrees by construction**: so they do, and could hardly do otherwise, because rig or method was
  built by the thesis's words.
- **same conclusions**: all conclusions hold, the figures do not agree.
- **partly**: a part holds, or figures lie in the band and no nearer than a constant; no conclusion
  is reversed.
- **differs**: a conclusion is reversed, or none holds and no kind of figures lies in the band; with
  the reason where a run backs one.
- **not comparable**: with the reason.
- **see elsewhere**: another subject has the same comparison, and a comparison has one verdict.
- **our choice**: no subject of the thesis, but what it leaves open and we had to choose.

The rig of the study is not that of the demo: it has less dry friction, more damping, another gain
of the base gauge, and for identification more noise. [The
calibration](../rig.md#rig-of-the-reproduction) chose them so that these same figures lie near the
thesis's, so figures that agree are no evidence of their own. What else was chosen stands under
[sensitivity](sensitivity.md).
"""
_EARLIER = Path(__file__).with_name("earlier.yaml")
_TITLES = {"chapter": "Chapter {}", APPENDICES: "Appendices", SENSITIVITY: "Sensitivity"}
_MARKS = {
    Verdict.AGREES: "✔",
    Verdict.BY_CONSTRUCTION: "=",
    Verdict.SAME_CONCLUSIONS: "≈",
    Verdict.PARTLY: "◐",
    Verdict.DIFFERS: "✘",
    Verdict.NOT_COMPARABLE: "-",
    Verdict.ELSEWHERE: "→",
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
    yield ""
    yield from _table(("", "figures that agree", *_OUTCOMES), _parts(pages))
    for page, part in pages.items():
        yield f"\n## {_title(page)}\n"
        rows = (
            (
                f"[{subject.key}]({page}.md#{subject.key})",
                _escaped(subject.title),
                _figures(finding.judgement),
                _conclusions(finding.judgement),
                _mark(finding),
            )
            for subject, finding in part
        )
        yield from _table(("", "what it shows", "figures", "conclusions", "verdict"), rows)
    yield "\n## What moved\n"
    yield "Verdicts of the earlier edition, by its own rules, beside those of this one.\n"
    yield from _table(("", "earlier", "now", "why"), _moved(pages))


def _counts(pages: dict[str, list[tuple[Subject, Finding]]]) -> Iterator[tuple[str, ...]]:
    for title, part in _by_title(pages).items():
        found = count([finding.judgement for _, finding in part])
        yield title, *(str(found[kind]) for kind in Verdict)
    earlier = _earlier()
    names = {"same ranking": Verdict.SAME_CONCLUSIONS.value}
    words = [names.get(word, word) for word in earlier.values()]
    label = "earlier edition, by its own rules, its *same ranking* under same conclusions"
    yield label, *(str(words.count(kind.value)) for kind in Verdict)


def _parts(pages: dict[str, list[tuple[Subject, Finding]]]) -> Iterator[tuple[str, ...]]:
    for title, part in _by_title(pages).items():
        figures = [each for _, finding in part for each in finding.judgement.figures]
        statements = [each for _, finding in part for each in finding.judgement.statements]
        held, turned = (
            sum(getattr(each, name) for each in statements) for name in ("holds", "is_reversed")
        )
        yield (
            title,
            f"{sum(each.agrees for each in figures)} of {len(figures)} kinds",
            *map(str, (held, len(statements) - held - turned, turned)),
        )


_OUTCOMES = ("conclusions that hold", "open", "reversed")


def _by_title(
    pages: dict[str, list[tuple[Subject, Finding]]],
) -> dict[str, list[tuple[Subject, Finding]]]:
    parts = {f"[{_title(page)}]({page}.md)": part for page, part in pages.items()}
    return {**parts, "all": [each for part in pages.values() for each in part]}


def _figures(judgement: Judgement) -> str:
    return "; ".join(
        f"{each.within} of {len(each.thesis)}"
        + ("" if each.beats_constant else ", no nearer than a constant")
        for each in judgement.figures
    )


def _conclusions(judgement: Judgement) -> str:
    if not judgement.statements:
        return ""
    turned = f", {len(judgement.reversed)} reversed" if judgement.reversed else ""
    return f"{len(judgement.held)} of {len(judgement.statements)}{turned}"


@cache
def _earlier() -> dict[str, str]:
    kinds = yaml.safe_load(_EARLIER.read_text("utf-8"))
    return {key: verdict for verdict, keys in kinds.items() for key in keys}


def _moved(pages: dict[str, list[tuple[Subject, Finding]]]) -> Iterator[tuple[str, ...]]:
    now = {subject.key: finding for part in pages.values() for subject, finding in part}
    for key, before in _earlier().items():
        if key not in now:
            if page_of(key) in pages:
                yield key, before, "left out", _LEFT_OUT.get(key, "")
            continue
        judgement = now[key].judgement
        if judgement.verdict.value == before:
            continue
        yield key, before, judgement.verdict.value, _escaped(_why(judgement))


_LEFT_OUT = {
    "figure-3-27": "the thesis does not print it",
    "choice-2-1": "it stands under [sensitivity](sensitivity.md)",
}


def _why(judgement: Judgement) -> str:
    if not (judgement.figures or judgement.statements):
        sentences = judgement.because.removesuffix(".").split(". ")
        # The last one of a subject without a verdict of its own names that which has it.
        return sentences[-1 if judgement.verdict is Verdict.ELSEWHERE else 0]
    parts = [f"figures: {_figures(judgement)}"] if judgement.figures else []
    if judgement.statements:
        parts.append(f"conclusions: {_conclusions(judgement)}")
    missed = [each.words for each in judgement.statements if not each.holds]
    return "; ".join(parts) + (f" ({'; '.join(missed)})" if missed else "")


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
