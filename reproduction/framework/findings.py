"""What came of reproducing one table or figure, and the verdict on it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class Verdict(Enum):
    """How a result of ours stands to the thesis's."""

    AGREES = "agrees"
    SAME_RANKING = "same ranking"
    DIFFERS = "differs"


@dataclass(frozen=True)
class Judgement:
    """A verdict and what it rests on.

    Attributes
    ----------
    verdict
        How ours stands to the thesis's.
    because
        The evidence in one or two sentences, with figures; where ours differs, why it does.

    Raises
    ------
    ValueError
        When it rests on nothing.
    """

    verdict: Verdict
    because: str

    def __post_init__(self) -> None:
        if not self.because.strip():
            raise ValueError(f"a verdict ({self.verdict.value}) has to say what it rests on")


@dataclass(frozen=True)
class SideBySide:
    """A table with the thesis's figures beside ours.

    Attributes
    ----------
    title
        What it lists.
    headings
        One per column.
    rows
        Cells as text, as many in each row as there are headings.

    Raises
    ------
    ValueError
        When a row has another number of cells.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.headings):
                raise ValueError(
                    f"{self.title}: {len(row)} cells under {len(self.headings)}: {row}"
                )


@dataclass(frozen=True)
class Plot:
    """A picture: its caption and its SVG."""

    caption: str
    svg: str


@dataclass(frozen=True)
class Finding:
    """One table, figure or claim of the thesis beside ours.

    Attributes
    ----------
    judgement
        The verdict and its evidence.
    tables, plots
        The figures and the pictures.
    text
        Paragraphs of Markdown that stand before them: what was done, and with what.
    """

    judgement: Judgement
    tables: Sequence[SideBySide] = ()
    plots: Sequence[Plot] = ()
    text: Sequence[str] = ()


def judged(*, agrees: bool, same_ranking: bool, evidence: str, reason: str) -> Judgement:
    """Judge by the two criteria of a subject.

    Parameters
    ----------
    agrees, same_ranking
        Whether the figures agree within the subject's tolerance; whether at least the order of
        the compared things is the thesis's.
    evidence
        What was found, with figures.
    reason
        Why ours differs; used only when it does.
    """
    if agrees:
        return Judgement(Verdict.AGREES, evidence)
    if same_ranking:
        return Judgement(Verdict.SAME_RANKING, evidence)
    return Judgement(Verdict.DIFFERS, f"{evidence} {reason}".strip())


def count(judgements: Sequence[Judgement]) -> Mapping[Verdict, int]:
    """Count the verdicts of each kind."""
    return {kind: sum(each.verdict is kind for each in judgements) for kind in Verdict}
