"""The index of equations lists each equation once and says where it lives."""

from __future__ import annotations

import importlib
import re
from typing import Any, NamedTuple

import pytest

from support.project import PROJECT

ROOT = PROJECT
# The thesis's last equation of each chapter.
LAST = {2: 28, 3: 21, 4: 9}
EQUATIONS = [f"{chapter}-{i}" for chapter, last in LAST.items() for i in range(1, last + 1)]

# What a docstring cites: one equation or several, or spans of them.
_SPAN = r"[2-4]-\d+(?: (?:\.\.|to) [2-4]-\d+)?"
_CITATION = re.compile(rf"\(({_SPAN}(?:, {_SPAN})*)\)")
_NAME = re.compile(r"`([\w.]+:[\w.]+)`")
_ERRATUM = "[erratum](errata.md)"


class Entry(NamedTuple):
    """One row of the index."""

    equation: str
    meaning: str
    where: str
    note: str

    @property
    def names(self) -> list[str]:
        """Names that compute the equation."""
        return _NAME.findall(self.where)


def _rows(page: str) -> list[list[str]]:
    lines = (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in lines if line[:1] == "|"]
    return [row for row in rows if re.match(r"\(?\d-\d", row[0])]


ENTRIES = [Entry(row[0].strip("()"), *row[1:]) for row in _rows("equations.md")]


def _cited(text: str) -> set[str]:
    """Return the equations that a text names."""
    line = " ".join(text.split())
    joined = re.sub(r"\(([2-4]-\d+)\) to \(([2-4]-\d+)\)", r"(\1 to \2)", line)
    cited: set[str] = set()
    for citation in _CITATION.findall(joined):
        for span in citation.split(", "):
            first, *last = re.findall(r"(\d)-(\d+)", span)
            chapter, end = last[0] if last else first
            assert chapter == first[0], f"({span}) spans two chapters"
            cited |= {f"{chapter}-{i}" for i in range(int(first[1]), int(end) + 1)}
    return cited


def _found(name: str) -> tuple[Any, Any]:
    module_name, _, path = name.partition(":")
    module = importlib.import_module(module_name)
    found = module
    for part in path.split("."):
        found = getattr(found, part)
    return module, found


@pytest.mark.parametrize(
    ("text", "equations"),
    [
        ("law (4-7), loop (4-2)", {"4-7", "4-2"}),
        ("(2-9 ..\n2-11, 3-2)", {"2-9", "2-10", "2-11", "3-2"}),
        ("(4-6) to (4-8)", {"4-6", "4-7", "4-8"}),
        ("(4-6 to 4-8)", {"4-6", "4-7", "4-8"}),
        ("Figure 2-3, (Table 4-2), (Figure 4-10 c, d), (section 2.4), i - (3-1j)", set()),
    ],
)
def test_cited___citations___are_read_and_nothing_else(text: str, equations: set[str]) -> None:
    assert _cited(text) == equations


def test_index___lists___each_equation_once_in_order() -> None:
    assert [entry.equation for entry in ENTRIES] == EQUATIONS


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.equation)
def test_entry___has___a_meaning_and_a_name_or_a_reason(entry: Entry) -> None:
    assert entry.meaning
    if entry.where == "none":
        assert len(entry.note.split()) > 3, "an absence needs its reason"
    else:
        assert ", ".join(f"`{name}`" for name in entry.names) == entry.where


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.equation)
def test_entry___names___are_public_and_live_there(entry: Entry) -> None:
    for name in _NAME.findall(entry.where + entry.note):
        assert not re.search(r"(^|[.:])_", name)
        module, found = _found(name)
        assert callable(found)
        assert found.__module__ == module.__name__, "it only passes through here"


@pytest.mark.parametrize(
    ("equation", "name"),
    [(entry.equation, name) for entry in ENTRIES for name in entry.names],
)
def test_docstring___of_a_listed_name_or_its_module___gives_the_equation(
    equation: str, name: str
) -> None:
    module, found = _found(name)
    assert equation in _cited(f"{found.__doc__} {module.__doc__}")


def test_errata___of_equations___are_marked_in_the_index() -> None:
    misprinted = {
        f"{chapter}-{i}"
        for row in _rows("errata.md")
        for chapter, i in re.findall(r"(\d)-(\d+)", row[0])
    }
    marked = {entry.equation for entry in ENTRIES if _ERRATUM in entry.note}
    assert marked == misprinted


def test_sources___name___only_equations_that_exist() -> None:
    unknown = {
        str(path.relative_to(ROOT)): missing
        for path in (ROOT / "src").rglob("*.py")
        if (missing := _cited(path.read_text(encoding="utf-8")) - set(EQUATIONS))
    }
    assert not unknown


def test_block_diagrams___name_what_runs_them() -> None:
    names = _NAME.findall((ROOT / "docs/block_diagrams.md").read_text("utf-8"))
    assert len(names) >= 6
    assert all(callable(_found(name)[1]) for name in names)
