"""Subjects, their findings, and the evidence that a verdict rests on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import yaml
from scipy import stats

from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    Results: TypeAlias = "Mapping[Call, Any]"

Figures: TypeAlias = "Sequence[float] | NDArray[np.float64] | NDArray[np.int_]"
"""A figure of many runs, one per seed."""

SENSORS = ("position", "base gauge", "middle gauge", "speed")
"""Words for the four sensors on the pages, in the order of `flexarm_ident`'s `ARM_OUTPUTS`."""
SEEDS = tuple(range(1, 21))
"""Seeds of the runs that a claim or a scatter rests on."""
OFTEN = 0.5
"""An event in more than this share of the seeds occurs in most of them."""
LEVEL = 0.05
"""A claim holds when chance alone would bear it out as often in fewer than 5 % of all cases."""
_THESIS, _TEXTS = (Path(__file__).parents[1] / name for name in ("thesis", "texts"))


class ReproductionError(FlexarmError):
    """A request that cannot be run."""


class Verdict(Enum):
    """Relation of our result to the thesis's."""

    AGREES = "agrees"
    BY_CONSTRUCTION = "agrees by construction"
    SAME_RANKING = "same ranking"
    DIFFERS = "differs"
    OURS = "our choice"


@dataclass(frozen=True)
class Judgement:
    """Verdict and its evidence: figures in one or two sentences, and the reason of a difference."""

    verdict: Verdict
    because: str

    def __post_init__(self) -> None:
        if not self.because.strip():
            raise ValueError(f"a verdict ({self.verdict.value}) has to say what it rests on")


@dataclass(frozen=True)
class SideBySide:
    """Table with the thesis's figures beside ours; each row has a cell per heading."""

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
    judgement : Judgement
        The verdict and its evidence.
    tables : sequence of SideBySide
        The figures.
    plots : sequence of Plot
        The pictures.
    text : sequence of str
        Paragraphs of Markdown before them: what was done, and with what.
    """

    judgement: Judgement
    tables: Sequence[SideBySide] = ()
    plots: Sequence[Plot] = ()
    text: Sequence[str] = ()


@dataclass(frozen=True)
class Call:
    """One computation that takes a while; the same call gives the same result.

    Attributes
    ----------
    function : callable
        A function at the top level of a module; its result can be pickled.
    arguments : tuple
        Plain values: texts, numbers and tuples of them. A seed is one of them.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()

    @property
    def name(self) -> str:
        """The call as it would be written."""
        words = ", ".join(map(repr, self.arguments))
        return f"{self.function.__module__}.{self.function.__qualname__}({words})"

    def __call__(self) -> Any:  # noqa: ANN401 - whatever the function returns
        """Compute it."""
        return self.function(*self.arguments)


@dataclass(frozen=True)
class Subject:
    """A table, figure or claim of the thesis.

    Attributes
    ----------
    key : str
        Its name on the command line, such as ``table-2-4``, ``figure-4-11`` or ``claim-2-1``.
    title : str
        The thesis's contents there, in our words.
    needs : tuple of Call
        Its computations. They run in parallel, are shared between subjects, and are kept.
    build : callable
        Turns their results into the finding; takes a second at most.
    """

    key: str
    title: str
    needs: tuple[Call, ...]
    build: Callable[[Results], Finding]


def columns(line: str) -> tuple[str, ...]:
    """Return the headings of a table from one line in which bars part them.

    Examples
    --------
    >>> columns("step | error, V")
    ('step', 'error, V')
    """
    return tuple(line.split(" | "))


def judged(
    *,
    agrees: bool,
    same_ranking: bool,
    evidence: str,
    reason: str,
    by_construction: bool = False,
) -> Judgement:
    """Judge by the two criteria of a subject.

    Parameters
    ----------
    agrees, same_ranking : bool
        The figures agree within the subject's tolerance; at least their order is the thesis's.
    evidence : str
        Our result, with figures.
    reason : str
        Reason of a difference; used only for one. Its figures are computed, as those of the
        evidence are.
    by_construction : bool
        Whether what agrees was built by the thesis's words, and says little of our results.
    """
    if agrees:
        return Judgement(Verdict.BY_CONSTRUCTION if by_construction else Verdict.AGREES, evidence)
    if same_ranking:
        return Judgement(Verdict.SAME_RANKING, evidence)
    return Judgement(Verdict.DIFFERS, f"{evidence} {reason}".strip())


def count(judgements: Sequence[Judgement]) -> Mapping[Verdict, int]:
    """Count the verdicts of each kind."""
    return {kind: sum(each.verdict is kind for each in judgements) for kind in Verdict}


@cache
def thesis_table(name: str) -> Any:  # noqa: ANN401 - each table has a shape of its own
    """Return a table of the thesis by the name of its file in `thesis`, such as ``table_2_4``."""
    return yaml.safe_load((_THESIS / f"{name}.yaml").read_text("utf-8"))


@cache
def _texts() -> dict[str, dict[str, str]]:
    pages = (yaml.safe_load(path.read_text("utf-8")) for path in sorted(_TEXTS.glob("*.yaml")))
    return {name: parts for page in pages for name, parts in page.items()}


def prose(name: str, **values: object) -> str:
    """Return a text of the folder `texts`, such as ``claim-2-6.reason``, with values put in."""
    subject_key, part = name.split(".")
    return _texts()[subject_key][part].format(**values)


def subject(key: str, needs: tuple[Call, ...], build: Callable[[Results], Finding]) -> Subject:
    """Return a subject with its title from the folder `texts`."""
    return Subject(key, prose(f"{key}.title", seeds=len(SEEDS)), needs, build)


def sign_test(smaller: Figures, larger: Figures) -> float:
    """Return the probability that chance makes as many pairs come out in this order.

    The exact one-sided sign test; ties count against the claim.

    Parameters
    ----------
    smaller, larger : sequence of float
        Figures of the same runs; the claim is that the first is the smaller one.

    Raises
    ------
    ValueError
        For sequences of different lengths.
    """
    wins = sum(bool(a < b) for a, b in zip(smaller, larger, strict=True))
    return float(stats.binomtest(wins, len(smaller), alternative="greater").pvalue)


def p_text(p_value: float) -> str:
    """Return a p-value as text."""
    return f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"  # noqa: PLR2004


def spread(values: Figures, form: str = ".3f") -> str:
    """Return median and range of a figure over the seeds, as text."""
    low, middle, high = np.quantile(np.asarray(values), (0.0, 0.5, 1.0)).tolist()
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"


def percent(shares: Sequence[float] | NDArray[np.float64], separator: str = ", ") -> str:
    """Return shares as text."""
    return separator.join(f"{share:.0%}" for share in shares)
