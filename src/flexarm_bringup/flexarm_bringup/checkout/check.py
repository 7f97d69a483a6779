"""`flexarm test` and `flexarm bench`: what is run out of the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NoReturn

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError

_READ = (
    ("lint", ["ruff", "check"]),
    ("format", ["ruff", "format", "--check"]),
    ("types", ["mypy"]),
)
_QUICK = (
    *_READ,
    ("unit tests", ["pytest", "--numprocesses", "auto", "-m", "not slow", "test/unit"]),
)
_ALL = (
    *_READ,
    ("unit tests", ["pytest", "--numprocesses", "auto", "--ignore", "test/system"]),
    # Their nodes wait more than they work, and some keep the time: two at once, on any machine.
    ("system tests", ["pytest", "--numprocesses", "2", "--dist", "worksteal", "test/system"]),
)


def check_everything(arguments: tuple[str, ...], *, quick: bool = False) -> int:
    """Run all checks, or the quick ones, or pytest with the arguments; return the exit code.

    Parameters
    ----------
    arguments
        Of pytest; none: all checks.
    quick
        Leave out the tests that are marked slow and all that are no unit tests.

    Raises
    ------
    LaunchError
        Outside a checkout.
    """
    root = checkout("tests")
    checks = (("tests", ["pytest", *arguments]),) if arguments else _QUICK if quick else _ALL
    failed = []
    for name, (tool, *options) in checks:
        terminal.step(f"{name}: {' '.join((tool, *options))}")
        command = [sys.executable, "-m", tool, *options]
        started_s = time.monotonic()
        if subprocess.run(command, cwd=root, check=False).returncode != 0:  # noqa: S603
            failed.append(name)
        terminal.CONSOLE.print(f"  {name} took {time.monotonic() - started_s:.0f} s")
    if quick:
        terminal.CONSOLE.print(
            "  left out: tests marked slow, property, fault and system tests; "
            "./flexarm test runs them all"
        )
    if failed:
        terminal.CONSOLE.print(f"[bold red]failed: {', '.join(failed)}[/bold red]")
    return 1 if failed else 0


def run_bench(name: str, arguments: tuple[str, ...]) -> int:
    """Run one benchmark of the folder `bench` with its arguments; return the exit code.

    Raises
    ------
    LaunchError
        Outside a checkout.
    """
    root = checkout("benchmarks")
    (file,) = root.glob(f"bench/*/{name}.py")
    command = [sys.executable, "-m", f"bench.{file.parent.name}.{name}", *arguments]
    return subprocess.run(command, check=False, env=_environment(root)).returncode  # noqa: S603


def run_study(arguments: tuple[str, ...]) -> NoReturn:
    """Let the program of the folder `reproduction` take the place of this process.

    So its exit code, the terminal and Ctrl-C are its own.

    Raises
    ------
    LaunchError
        Outside a checkout.
    """
    environment = _environment(checkout("programs of the reproduction"))
    command = [sys.executable, "-m", "reproduction", *arguments]
    os.execve(sys.executable, command, environment)  # noqa: S606 - our own program


def _environment(root: Path) -> dict[str, str]:
    """Return this process's environment, in which its children find the folders of the checkout."""
    paths = [str(root), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def checkout(what: str) -> Path:
    """Return the folder of the checkout.

    Parameters
    ----------
    what
        What is looked for there, for the message.

    Raises
    ------
    LaunchError
        Outside a checkout.
    """
    root = os.environ.get("FLEXARM_ROOT")
    if root is None or not Path(root, "pyproject.toml").is_file():
        raise LaunchError(f"the {what} live in the checkout: run ./flexarm there")
    return Path(root)
