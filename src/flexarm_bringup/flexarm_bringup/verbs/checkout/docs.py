"""Verb docs: site of the pages that works offline, and a run of what they show."""

from __future__ import annotations

import gc
import io
import logging
import shutil
import sys
from contextlib import contextmanager, redirect_stderr
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, examples
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.checks import EXAMPLES, passes
from flexarm_bringup.verbs.checkout.folder import checkout
from flexarm_bringup.verbs.checkout.pages import steps
from flexarm_bringup.verbs.checkout.transcripts import outdated
from flexarm_core.outputs import MARK, is_replaceable

if TYPE_CHECKING:
    from collections.abc import Iterator

_MANY_OBJECTS = 1_000_000
_BUILD = ".buildinfo"
"""File that Sphinx writes with a site."""
_TOOLS = ("sphinx", "myst_parser", "furo", "sphinx_copybutton")
"""What Sphinx is asked for in `docs/conf.py`."""
_NOT_REPRODUCED = """\
# The thesis, reproduced

Not in this checkout. `./flexarm reproduce all -o docs/reproduction` makes it.
"""


@click.command()
@click.argument("pages", nargs=-1, type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/docs"),
    show_default=True,
    help="Folder of the site.",
)
@FORCE
@examples("docs", "docs docs/tutorial.md")
def docs(pages: tuple[Path, ...], out: Path, *, force: bool) -> None:
    """Build the pages as a site, and run what they show.

    Runs the examples and the commands of all pages, compares the outputs and figures with those
    that the pages show, and builds the site, which works offline. With PAGES, only their commands
    are run, and nothing is built.
    """
    root = checkout("pages")
    hold = bool(pages) or passes("examples", EXAMPLES, root)
    for page in [page.resolve() for page in pages] or _pages(root):
        terminal.step(f"commands: {page.relative_to(root)}")
        for line in outdated(root, page):
            hold = False
            terminal.CONSOLE.print(line)
    if not pages:
        terminal.step(f"site: {out / 'index.html'}")
        if warnings := build_site(root, out, force=force):
            hold = False
            terminal.CONSOLE.print(warnings)
    sys.exit(0 if hold else 1)


def _pages(root: Path) -> list[Path]:
    """Return the pages with commands that are run."""
    written = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    return [page for page in written if next(steps(page.read_text("utf-8")), None) is not None]


def build_site(root: Path, out: Path, *, force: bool = False) -> str:
    """Build the site from a checkout, in place of an older one; return the warnings, a line each.

    Raises
    ------
    LaunchError
        Without Sphinx or what it is asked for, or when `out` holds something else than a site of
        ours and `force` is not set.
    """
    if missing := [tool for tool in _TOOLS if find_spec(tool) is None]:
        raise LaunchError(f"no module {', '.join(missing)}: install requirements/dev.in")
    from sphinx.cmd.build import build_main  # noqa: PLC0415 - it may be missing, and takes long

    if out.exists() and any(out.iterdir()) and not (force or _is_site(out)):
        raise LaunchError(
            f"{out} holds something else than a site of flexarm: choose another folder, or replace "
            "all in it with --force"
        )
    with TemporaryDirectory(prefix="flexarm-docs-") as scratch:
        pages, site = Path(scratch, "docs"), Path(scratch, "site")
        # Sphinx writes the pages of the reference beside the others.
        shutil.copytree(root / "docs", pages)
        Path(scratch, "src").symlink_to(root / "src")
        if not (pages / "reproduction").exists():
            (pages / "reproduction").mkdir()
            (pages / "reproduction" / "index.md").write_text(_NOT_REPRODUCED, "utf-8")
        with _at_work(), redirect_stderr(io.StringIO()) as said:
            build_main(["-b", "html", "-q", "-N", str(pages), str(site)])
        if (site / _BUILD).is_file():
            words = (site / _BUILD).read_text("utf-8")
            (site / _BUILD).write_text(f"# {MARK}\n{words}", "utf-8")
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(site, out, ignore=shutil.ignore_patterns(".doctrees"))
    return said.getvalue().replace(f"{pages}/", "docs/")


@contextmanager
def _at_work() -> Iterator[None]:
    """Let Sphinx make no records below warnings, and look for garbage when there is some.

    It holds all pages as trees until its end: a look over them finds nothing.
    """
    often = gc.get_threshold()
    gc.set_threshold(_MANY_OBJECTS, *often[1:])
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)
        gc.set_threshold(*often)


def _is_site(folder: Path) -> bool:
    build = folder / _BUILD
    return build.is_file() and is_replaceable(build)
