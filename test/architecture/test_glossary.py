"""Terms of the field in all that a user reads, and none of the words that they replaced."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

import pytest

from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

GLOSSARY = PROJECT / "docs/glossary.md"
SUFFIXES = {".py", ".js", ".html", ".j2", ".yaml", ".md", ".ipynb"}
# What is not said any more, and the term of the glossary in its place.
REPLACED = {
    r"a line at zero|the mean has 1\b": "fit",
    r"data \(DMV\)": "simulation with measured input",
    r"set-point \(SFV\)": "closed-loop simulation",
    r"left out \(CV\)|data that were not fitted": "5-fold cross-validation",
    r"error's power|follows? the inputs?\b": "coherent with the input",
    r"take it away|a better model could": "coherent with the input",
    r"\buseless\b": "not usable",
    r"mend the data|mind the data": "fix the data",
    r"drive harder|harder driving": "excitation amplitude",
    r"\brichness\b": "persistence of excitation",
    r"bears_feedback": "consistent under feedback",
    r"output without (an )?answer": "no response to the input",
    r"held drive": "input idle",
    r"number of moves|too few moves": "input transitions",
    r"change of the law\b(?!')|change of plant or law": "controller change",
    r"nothing found": "pass",
    r"\bit vibrates at|\bits vibrations? at": "lightly damped mode",
    r"at most one of (them|the two|close)|one of these at most": "split pole",
    r"calm after": "residual vibration",
    r"\brungs\b": "friction model",
    r"weighs the payload": "estimates the payload online",
    r"each input acts until": "input hold",
    r"level subtracted|level at rest is subtracted": "offset removed",
    r"\bmend(s|ed)?\b": "fix the data",
    r"\bcalm\b": "settled",
    r"\bbears?\b": "",
    r"\btells\b(?! them to\b|.* (apart|from)\b)": "",
    r"\b_?(un)?told_\w|\w_told\b|\b_?told\b(?= ?[=:.(\[])|\b_?tell_\w": "",
    # No term, but the order of words in English: "is not a number".
    r"(?<!there\s)\b(is|are) no (?!longer|better|larger|farther|more|such)\w|\bholds no\b": "",
}


@cache
def read_by_users() -> dict[Path, str]:
    """Return the texts of sources, pages and examples, without the thesis's own words."""
    folders = (PROJECT / folder for folder in ("src", "docs", "examples"))
    paths = [PROJECT / "README.md", *(path for folder in folders for path in folder.rglob("*"))]
    return {
        path: path.read_text("utf-8")
        for path in paths
        if path.suffix in SUFFIXES and "reproduction" not in path.parts
    }


def lines_with(text: str, words: str) -> Iterator[int]:
    """Yield the lines, from 1, on which a pattern begins; a sentence may be wrapped."""
    pattern = re.compile(words.replace(" ", r'[\s"]+'), re.IGNORECASE)
    for found in pattern.finditer(text):
        yield text.count("\n", 0, found.start()) + 1


@pytest.mark.parametrize(("words", "term"), REPLACED.items())
def test_sources_and_pages___say___the_terms_of_the_glossary(words: str, term: str) -> None:
    found = [
        f"{path.relative_to(PROJECT)}:{line}: say {term!r}"
        for path, text in read_by_users().items()
        for line in lines_with(text, words)
    ]
    assert found == []


@pytest.mark.parametrize("term", sorted(filter(None, set(REPLACED.values()))))
def test_glossary___has___each_term(term: str) -> None:
    assert term in GLOSSARY.read_text("utf-8").lower()


def test_lines_with___sentence_that_is_wrapped_in_a_string___is_found() -> None:
    assert list(lines_with('x = (\n    "mend the "\n    "data first"\n)', "mend the data")) == [2]
