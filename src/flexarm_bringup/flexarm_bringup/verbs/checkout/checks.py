"""Verb test: lint, types, examples and tests of the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import RUN_ON, examples
from flexarm_bringup.verbs.checkout.folder import checkout

if TYPE_CHECKING:
    from pathlib import Path

DOCTEST = ("pytest", "--doctest-modules", "--doctest-glob", "*.md")
"""Pytest on the examples of docstrings and pages; the blocks of a page go on from one another."""
EXAMPLES = (*DOCTEST, "--doctest-ignore-import-errors", "src", "reproduction", "docs")
BY_FILE = ("--dist", "loadfile", "--no-loadscope-reorder")
"""Spread of the tests over workers: files in their order, which begins with the slow ones."""
_QUICK_FOLDERS = ("test/unit", "test/architecture")
_READ = (
    ("lint", ("ruff", "check")),
    ("format", ("ruff", "format", "--check")),
    ("types", ("mypy",)),
    ("examples", EXAMPLES),
)
_QUICK = (
    *_READ,
    ("unit tests", ("pytest", "-n", "auto", *BY_FILE, "-m", "not slow", *_QUICK_FOLDERS)),
)
# What the tests of a file share is computed once: a file stays with one worker. System tests wait
# more than they work: between the others, and with one worker more, they leave no core idle.
_WORKERS = str((os.cpu_count() or 1) + 1)
_ALL = (*_READ, ("tests", ("pytest", "-n", _WORKERS, *BY_FILE)))


@click.command(context_settings=RUN_ON)
@click.option("--quick", is_flag=True, help="Lint, types and quick unit tests: three minutes.")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
@examples("test", "test --quick", "test test/unit -k margins")
def test(arguments: tuple[str, ...], *, quick: bool) -> None:
    """Lint, check types and run the tests.

    With arguments, run pytest with them only.
    """
    if quick and arguments:
        raise click.UsageError(
            f"--quick chooses the tests: leave out {' '.join(arguments)}, or leave out --quick and "
            'say -m "not slow"'
        )
    checks = (("tests", ("pytest", *arguments)),) if arguments else _QUICK if quick else _ALL
    root = checkout("tests")
    failed = [name for name, command in checks if not passes(name, command, root)]
    if quick:
        terminal.CONSOLE.print(
            "  left out: tests marked slow, property, fault and system tests; "
            "./flexarm test runs them all"
        )
    if failed:
        terminal.CONSOLE.print(f"[bold red]failed: {', '.join(failed)}[/bold red]")
    sys.exit(1 if failed else 0)


def passes(name: str, command: tuple[str, ...], root: Path) -> bool:
    """Announce and run a Python tool in the checkout; return whether it succeeded."""
    terminal.step(f"{name}: {' '.join(command)}")
    started_s = time.monotonic()
    line = [sys.executable, "-m", *command]
    done = subprocess.run(line, cwd=root, check=False)  # noqa: S603 - our own tools
    terminal.CONSOLE.print(f"  {name} took {time.monotonic() - started_s:.0f} s")
    return done.returncode == 0
