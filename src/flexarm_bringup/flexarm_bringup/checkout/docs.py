"""`flexarm docs`: the pages of the folder docs as a site, and their examples run."""

from __future__ import annotations

import io
import shutil
from contextlib import redirect_stderr
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from flexarm_bringup.checkout.api_pages import toctree, write_api_pages
from flexarm_bringup.checkout.check import checkout
from flexarm_bringup.checkout.doctests import (
    failures_in_module,
    failures_in_page,
    modules_with_examples,
    pages_with_examples,
)
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from collections.abc import Iterator

_NOT_REPRODUCED = """\
# The thesis, reproduced

Not in this checkout. `./flexarm reproduce all -o docs/reproduction` makes it.
"""


def build_docs(out: Path) -> int:
    """Run the examples, then build the site; return 1 when one fails or Sphinx warns.

    Parameters
    ----------
    out
        Folder of the site; what stands there is replaced.

    Raises
    ------
    LaunchError
        Outside a checkout, without Sphinx, or when `out` holds something else than a site.
    """
    root = checkout("pages")
    terminal.step("examples of docstrings and pages")
    failures = "".join(_failed_examples(root))
    if failures:
        terminal.CONSOLE.print(failures, markup=False)
    terminal.step(f"site: {out / 'index.html'}")
    warnings = build_site(root, out)
    if warnings:
        terminal.CONSOLE.print(warnings, markup=False)
    return 1 if failures or warnings else 0


def build_site(root: Path, out: Path) -> str:
    """Build the site from the pages and the sources of a checkout; return what Sphinx warns of.

    Parameters
    ----------
    root
        The checkout.
    out
        Folder of the site; what stands there is replaced.

    Raises
    ------
    LaunchError
        Without Sphinx, or when `out` holds something else than a site.
    """
    try:
        from sphinx.cmd.build import build_main  # noqa: PLC0415 - takes a second, may be missing
    except ImportError as error:
        raise LaunchError(f"{error}: install requirements/dev.in") from error
    if out.exists() and any(out.iterdir()) and not (out / ".buildinfo").is_file():
        raise LaunchError(f"{out} holds something else than a site: choose another folder")
    with TemporaryDirectory(prefix="flexarm-docs-") as scratch:
        pages, site = Path(scratch, "docs"), Path(scratch, "site")
        shutil.copytree(root / "docs", pages)
        write_api_pages(root / "src", pages / "api")
        _complete_reproduction(pages / "reproduction")
        with redirect_stderr(io.StringIO()) as said:
            build_main(["-b", "html", "-q", "-N", str(pages), str(site)])
        if (site / ".buildinfo").is_file():
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(site, out, ignore=shutil.ignore_patterns(".doctrees"))
    return said.getvalue().replace(f"{pages}/", "docs/")


def _complete_reproduction(folder: Path) -> None:
    """Put the pages below their index; where there are none, say so."""
    folder.mkdir(exist_ok=True)
    index = folder / "index.md"
    text = index.read_text("utf-8") if index.exists() else _NOT_REPRODUCED
    below = sorted(page.stem for page in folder.glob("*.md") if page != index)
    if below:
        # Below a later heading the pages would hang under that one.
        title, _, rest = text.partition("\n")
        text = f"{title}\n\n{toctree(below, hidden=True)}{rest}"
    index.write_text(text, "utf-8")


def _failed_examples(root: Path) -> Iterator[str]:
    for module in modules_with_examples(root / "src"):
        yield failures_in_module(module)
    for page in pages_with_examples(root / "docs"):
        yield failures_in_page(page)
