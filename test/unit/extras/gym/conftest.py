"""Tests of the environments, which need the package of an extra."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _pytest.terminal import TerminalReporter

_IS_THERE = find_spec("gymnasium") is not None

collect_ignore_glob = [] if _IS_THERE else ["test_*.py"]


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """Say that tests were left out."""
    if not _IS_THERE:
        terminalreporter.write_line("no tests of extras: pip install -r requirements/gym.in")
