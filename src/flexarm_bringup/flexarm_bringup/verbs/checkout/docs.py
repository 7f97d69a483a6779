"""Verb docs: site of the pages that works offline, and a run of what they show."""

from __future__ import annotations

import gc
import io
import logging
import os
import shutil
import signal
import subprocess
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
from flexarm_bringup.verbs.checkout.pages import (
    Step,
    differences,
    drawn_alike,
    folders,
    steps,
)
from flexarm_core.outputs import MARK, is_replaceable

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_MANY_OBJECTS = 1_000_000
_BUILD = ".buildinfo"
"""File that Sphinx writes with a site."""
_TOOLS = ("sphinx", "myst_parser", "furo", "sphinx_copybutton")
"""What Sphinx is asked for in `docs/conf.py`."""
_NOT_REPRODUCED = """\
# The thesis, reproduced

Not in this checkout. `./flexarm reproduce all -o docs/reproduction` makes it.
"""
_END_S = 30.0
_FIRST_DOMAIN, _DOMAINS = 10, 80
_ERROR = "flexarm: "
"""Beginning of a line that a page shows of a command that fails."""


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


def outdated(root: Path, page: Path) -> Iterator[str]:
    """Run the commands of a page; yield what it shows and they do not print, as they end.

    They run one after the other in a scratch folder, which has the files of the checkout without
    its `out`.
    """
    text = page.read_text("utf-8")
    with TemporaryDirectory(prefix="flexarm-page-") as scratch:
        folder = Path(scratch)
        for entry in root.iterdir():
            if entry.name != "out":
                (folder / entry.name).symlink_to(entry)
        for named in folders(text):
            shutil.copytree(root / named, folder, dirs_exist_ok=True)
        for step in steps(text):
            if step.file:
                (folder / step.file).write_text(step.text, "utf-8")
                continue
            name = f"{page.relative_to(root)}:{step.line}: {step.commands[0]}"
            if step.picture:
                yield from _otherwise(step, folder, page, root)
            else:
                yield from (f"{name}: {each}" for each in _wrong(step, folder))


def _otherwise(step: Step, folder: Path, page: Path, root: Path) -> Iterator[str]:
    """Draw a picture anew; yield that it is another one."""
    shown = page.parent / step.picture
    drawn = folder / shown.name
    again = Step(step.line, (f"{step.commands[0]} {drawn.name}",))
    name = f"{page.relative_to(root)}:{step.line}"
    yield from (f"{name}: {each}" for each in _wrong(again, folder))
    if drawn.exists() and not (
        shown.exists() and drawn_alike(shown.read_text("utf-8"), drawn.read_text("utf-8"))
    ):
        new = root / "out" / "figures" / shown.name
        new.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(drawn, new)
        yield (
            f"{name}: another picture now: look at {new}, and copy it to {shown.relative_to(root)}"
        )


def _wrong(step: Step, folder: Path) -> Iterator[str]:
    # Away from the graphs that run on this machine.
    environment = {**os.environ, "ROS_DOMAIN_ID": str(_FIRST_DOMAIN + os.getpid() % _DOMAINS)}
    if step.until:
        yield from _together(step, folder, environment)
        return
    running = _started(step.commands[0], folder, environment, subprocess.PIPE)
    printed, _ = running.communicate()
    fails = any(line.strip().startswith(_ERROR) for line in step.shown)
    if (running.returncode != 0) != fails:
        end = "\n    ".join(printed.strip().splitlines()[-3:])
        yield f"exit code {running.returncode}\n    {end}"
    # A page is of no folder.
    yield from differences(step.shown, printed.replace(f"{folder}/", ""))


def _together(step: Step, folder: Path, environment: Mapping[str, str]) -> Iterator[str]:
    """Run commands side by side until the last says its words, and interrupt them."""
    outputs = [subprocess.DEVNULL] * (len(step.commands) - 1) + [subprocess.PIPE]
    # `exec`: the signal is for the command, not for the shell that started it.
    running = [
        _started(f"exec {command}", folder, environment, output)
        for command, output in zip(step.commands, outputs, strict=True)
    ]
    said = running[-1].stdout
    try:
        if said is not None and not any(step.until in line for line in said):
            yield f"ended without {step.until!r}"
    finally:
        for each in running:
            each.send_signal(signal.SIGINT)
        for each in running:
            each.communicate(timeout=_END_S)


def _started(
    command: str, folder: Path, environment: Mapping[str, str], output: int
) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 - a command of our own pages
        ["/bin/bash", "-c", command],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT if output == subprocess.PIPE else output,
        text=True,
        encoding="utf-8",
    )
