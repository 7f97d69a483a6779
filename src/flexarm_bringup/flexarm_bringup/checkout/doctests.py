"""The examples in docstrings and pages: found, run, and compared with what they say."""

from __future__ import annotations

import doctest
import re
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_FENCED = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_PROMPT = ">>> "


def modules_with_examples(sources: Path) -> Iterator[str]:
    """Yield the names of the modules whose docstrings have examples.

    Parameters
    ----------
    sources
        The folder of the packages' sources.
    """
    for package in sorted(sources.iterdir()):
        for path in sorted((package / package.name).rglob("*.py")):
            if f"\n    {_PROMPT}" in path.read_text("utf-8"):
                yield ".".join(path.relative_to(package).with_suffix("").parts)


def pages_with_examples(folder: Path) -> Iterator[Path]:
    """Yield the Markdown pages that have examples."""
    for path in sorted(folder.rglob("*.md")):
        if _examples(path):
            yield path


def failures_in_module(name: str) -> str:
    """Return what the examples in a module's docstrings did else than they say, or nothing."""
    module = import_module(name)
    tests = doctest.DocTestFinder(exclude_empty=True).find(module)
    return "".join(_failures(test) for test in tests if test.examples)


def failures_in_page(path: Path) -> str:
    """Return what the examples of a page did else than they say, or nothing.

    The blocks of a page go on from one another. A block without a prompt is not run.
    """
    text = "\n".join(_examples(path))
    test = doctest.DocTestParser().get_doctest(text, {}, path.name, str(path), 0)
    return _failures(test)


def _examples(path: Path) -> list[str]:
    blocks: list[str] = _FENCED.findall(path.read_text("utf-8"))
    return [block for block in blocks if _PROMPT in block]


def _failures(test: doctest.DocTest) -> str:
    said: list[str] = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    return "".join(said)
