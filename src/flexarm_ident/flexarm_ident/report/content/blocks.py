"""Report blocks: paragraphs, tables, plots and lists, and the row that makes a section.

Each block names the macro of `templates/blocks.html.j2` that renders it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from flexarm_ident.models.model_parameters import ParameterValue
    from flexarm_ident.workflow.outcome import Outcome


class Block(Protocol):
    """A part of a section."""

    macro: ClassVar[str]


@dataclass(frozen=True)
class Words:
    """A paragraph of plain text."""

    macro: ClassVar[str] = "words"
    text: str


@dataclass(frozen=True)
class Heading:
    """A heading inside a section; level 2 is that of a section."""

    macro: ClassVar[str] = "heading"
    text: str
    level: int = 3


@dataclass(frozen=True)
class Table:
    """Cells of a table as text; the first column names the row.

    Attributes
    ----------
    name : str
        Class of the table in the page.
    about : str
        Description for screen readers.
    header : tuple of str
        Column titles.
    rows : tuple of tuple of str
        Cells.
    marked : tuple of bool
        Highlighted rows; empty for none.
    """

    macro: ClassVar[str] = "table"
    name: str
    about: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    marked: tuple[bool, ...] = ()


@dataclass(frozen=True)
class Plots:
    """Plots with their captions, which may be empty: side by side, or each as wide as the page."""

    macro: ClassVar[str] = "gallery"
    plots: tuple[tuple[str, str], ...]
    wide: bool = False


class Check(NamedTuple):
    """A check of the data: its name, and each finding with its figures."""

    name: str
    findings: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Checks:
    """Checks of the data with their findings."""

    macro: ClassVar[str] = "checks"
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Facts:
    """Pairs of a name and a value."""

    macro: ClassVar[str] = "facts"
    facts: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Card:
    """What a reader wants first.

    Attributes
    ----------
    level : str
        Level of the verdict, and class in the style sheet.
    verdict : str
        The verdict in words.
    figures : tuple of (str, str)
        The figures it rests on, and what each is.
    next_step : str
        What to do next, a sentence.
    facts : Facts
        What the verdict is of.
    picture : Plots
        One plot.
    """

    macro: ClassVar[str] = "card"
    level: str
    verdict: str
    figures: tuple[tuple[str, str], ...]
    next_step: str
    facts: Facts
    picture: Plots


class Download(NamedTuple):
    """A file inside a report: its name, its use, its size in kB, and its content as URI."""

    file: str
    use: str
    size_kb: float
    uri: str


@dataclass(frozen=True)
class Downloads:
    """Files inside the report."""

    macro: ClassVar[str] = "downloads"
    files: tuple[Download, ...]


@dataclass(frozen=True)
class Links:
    """Pairs of a text and a file beside the page."""

    macro: ClassVar[str] = "links"
    links: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Code:
    """A line of code."""

    macro: ClassVar[str] = "code"
    line: str


@dataclass(frozen=True, eq=False)
class Subject:
    """The identification that a report presents.

    Attributes
    ----------
    outcome : Outcome
        The validated model with its results.
    name : str
        Name of the model.
    parameters : mapping
        The model as flat parameters `models.<name>.*` with the fields of `model_provenance`.
    files : sequence of str
        Files of the model, each with its folder: the page may be copied elsewhere.
    begun : str
        Instant at which the first record begins, ISO 8601; empty when it is not known.
    """

    outcome: Outcome
    name: str
    parameters: Mapping[str, ParameterValue]
    files: Sequence[str] = ()
    begun: str = ""


@dataclass(frozen=True)
class Section:
    """A section of the report, which a module of `flexarm_ident.report.sections` holds.

    Attributes
    ----------
    place : int
        Sections follow each other by rising places.
    title : str
        Heading, and entry of the navigation.
    build : callable
        Yields the blocks.
    applies : callable
        Returns True when a report has the section.
    """

    place: int
    title: str
    build: Callable[[Subject], Iterable[Block]]
    applies: Callable[[Subject], bool] = lambda _subject: True

    @property
    def anchor(self) -> str:
        """Target of the navigation."""
        return self.title.lower().replace(" ", "-")
