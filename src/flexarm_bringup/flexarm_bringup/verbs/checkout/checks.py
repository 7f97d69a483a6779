"""Verb test: lint, types, examples and tests of the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import RUN_ON, examples
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.folder import checkout

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    Check = tuple[str, tuple[str, ...]]

DOCTEST = ("pytest", "--doctest-modules", "--doctest-glob", "*.md")
"""Pytest on the examples of docstrings and pages; the blocks of a page go on from one another."""
EXAMPLES = (*DOCTEST, "--doctest-ignore-import-errors", "src", "extras", "reproduction", "docs")
BY_FILE = ("--dist", "loadfile", "--no-loadscope-reorder")
"""Spread of the tests over workers: files in their order, which begins with the slow ones."""
_QUICK_FOLDERS = ("test/unit", "test/architecture")
_READ = (
    ("lint", ("ruff", "check")),
    ("format", ("ruff", "format", "--check")),
    ("types", ("mypy",)),
    ("examples", EXAMPLES),
)
# The numpy of an older Python has other annotations, which contradict the newer ones.
_TYPED_FROM = (3, 11)
_QUICK_ONES = ("-m", "not slow and not exhaustive", *_QUICK_FOLDERS)
_QUICK = ("unit tests", ("pytest", "-n", "auto", *BY_FILE, *_QUICK_ONES))
# What the tests of a file share is computed once: a file stays with one worker. System tests wait
# more than they work: between the others, and with one worker more, they leave no core idle.
_WORKERS = str((os.cpu_count() or 1) + 1)
_ALL = ("pytest", "-n", _WORKERS, *BY_FILE)
_DEFAULT = ("tests", (*_ALL, "-m", "not exhaustive"))
_EXHAUSTIVE = ("tests", (*_ALL, "--hypothesis-profile", "exhaustive"))


@click.command(context_settings=RUN_ON)
@click.option("--quick", is_flag=True, help="Lint, types and quick unit tests: four minutes.")
@click.option("--exhaustive", is_flag=True, help="Sweeps and whole chains, too.")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
@examples("test", "test --quick", "test --exhaustive", "test test/unit -k margins")
def test(arguments: tuple[str, ...], *, quick: bool, exhaustive: bool) -> None:
    """Lint, check types and run the tests.

    With arguments, run pytest with them only.
    """
    if quick and arguments:
        raise click.UsageError(
            f"--quick chooses the tests: leave out {' '.join(arguments)}, or leave out --quick and "
            'say -m "not slow"'
        )
    if exhaustive and (quick or arguments):
        other = "--quick" if quick else " ".join(arguments)
        raise click.UsageError(f"--exhaustive runs every test: leave it out, or leave out {other}")
    root = checkout("tests")
    if find_spec("pytest") is None:
        raise LaunchError(
            "no module pytest: the tests need all of the set-up, without FLEXARM_ROS=none"
        )
    checks, left_out = checks_of(sys.version_info[:2])
    if quick:
        checks = tuple(check for check in checks if check[1] != EXAMPLES)
    failed = [] if arguments else list(_failed_side_by_side(checks, root))
    if left_out and not arguments:
        terminal.CONSOLE.print(f"  {left_out}")
    chosen = _QUICK if quick else _EXHAUSTIVE if exhaustive else _DEFAULT
    name, command = ("tests", ("pytest", *arguments)) if arguments else chosen
    if not passes(name, command, root):
        failed.append(name)
    if quick:
        terminal.CONSOLE.print(
            "  left out: tests marked slow, property, fault and system tests, and examples of "
            "docstrings and pages; ./flexarm test runs them"
        )
    if failed:
        terminal.CONSOLE.print(f"failed: {', '.join(failed)}", style="bold red")
    sys.exit(1 if failed else 0)


def checks_of(version: tuple[int, ...]) -> tuple[tuple[Check, ...], str]:
    """Return the tools that read the checkout for a version of Python, and what is left out."""
    if version >= _TYPED_FROM:
        return _READ, ""
    words = f"left out: types, which Python {'.'.join(map(str, _TYPED_FROM))} and newer check"
    return tuple(check for check in _READ if check[0] != "types"), words


def passes(name: str, command: tuple[str, ...], root: Path) -> bool:
    """Announce and run a Python tool in the checkout; return whether it succeeded."""
    terminal.step(f"{name}: {' '.join(command)}")
    started_s = time.monotonic()
    done = subprocess.run(  # noqa: S603 - our own tools
        _line(command), cwd=root, check=False, env=_environment()
    )
    _report_time(name, started_s)
    return done.returncode == 0


def _failed_side_by_side(checks: tuple[Check, ...], root: Path) -> Iterator[str]:
    """Run tools on every core, and yield the names of those that fail.

    What a tool prints is shown when it and those before it have ended.
    """
    started_s = time.monotonic()

    def run(check: Check) -> subprocess.CompletedProcess[str]:
        return subprocess.run(  # noqa: S603 - our own tools
            _line(check[1]),
            cwd=root,
            check=False,
            env=_environment(),
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for (name, command), done in zip(checks, pool.map(run, checks), strict=True):
            terminal.step(f"{name}: {' '.join(command)}")
            click.echo(done.stdout, nl=False)
            _report_time(name, started_s)
            if done.returncode:
                yield name


def _line(command: tuple[str, ...]) -> list[str]:
    return [sys.executable, "-m", *command]


def _environment() -> dict[str, str]:
    # Each worker and each program of a test would compile every module again.
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def _report_time(name: str, started_s: float) -> None:
    terminal.CONSOLE.print(f"  {name} took {time.monotonic() - started_s:.0f} s")
