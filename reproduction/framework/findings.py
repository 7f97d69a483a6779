"""Subjects, their findings, and the words and figures that they are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import yaml

from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from reproduction.framework.verdicts import Figures, Judgement

    Results: TypeAlias = "Mapping[Call, Any]"

SENSORS = ("position", "base gauge", "middle gauge", "speed")
"""Words for the four sensors on the pages, in the order of `flexarm_ident`'s `ARM_OUTPUTS`."""
SEEDS = tuple(range(1, 21))
"""Seeds of the runs that a claim or a scatter rests on."""
OFTEN = 0.5
"""An event in more than this share of the seeds occurs in most of them."""
_THESIS, _TEXTS = (Path(__file__).parents[1] / name for name in ("thesis", "texts"))


class ReproductionError(FlexarmError):
    """A request that cannot be run."""


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


def spread(values: Figures, form: str = ".3f") -> str:
    """Return median and range of a figure over the seeds, as text."""
    low, middle, high = np.quantile(np.asarray(values), (0.0, 0.5, 1.0)).tolist()
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"


def percent(shares: Sequence[float] | NDArray[np.float64], separator: str = ", ") -> str:
    """Return shares as text."""
    return separator.join(f"{share:.0%}" for share in shares)
