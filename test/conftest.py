from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from pathlib import Path

# As in the command: the matrices are small, and the threads of BLAS would wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# How the launcher of these tests was called does not matter to what they expect.
os.environ.pop("FLEXARM_CALLED", None)

# A shell ignores SIGINT in what it runs in the background, and the programs of the tests would
# inherit that: Ctrl-C could not be tried.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# Behind `nohup` the nodes of the tests would stand alone.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# An example that takes long says that the machine is busy, and nothing about flexarm.
# A run says today what it says tomorrow; `--hypothesis-profile explore` looks elsewhere each time.
settings.register_profile("explore", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("exhaustive", settings.get_profile("explore"), derandomize=True)
settings.register_profile("flexarm", settings.get_profile("exhaustive"), max_examples=20)
settings.load_profile("flexarm")


_LEFT_OUT = pytest.StashKey[int]()
"""Number of exhaustive tests that were left out."""


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_LEFT_OUT] = 0


def pytest_deselected(items: list[pytest.Item]) -> None:
    if items and "not exhaustive" in items[0].config.option.markexpr:
        exhaustive = [item for item in items if item.get_closest_marker("exhaustive")]
        items[0].config.stash[_LEFT_OUT] += len(exhaustive)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:  # noqa: ANN401 - a worker of xdist
    # Each worker has collected all.
    node.config.stash[_LEFT_OUT] = getattr(node, "workeroutput", {}).get("left_out", 0)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if (output := getattr(session.config, "workeroutput", None)) is not None:
        output["left_out"] = session.config.stash[_LEFT_OUT]


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    if number := config.stash[_LEFT_OUT]:
        terminalreporter.write_line(
            f"left out: {number} exhaustive tests, and further seeds of others; "
            "./flexarm test --exhaustive runs them all"
        )


# Part of the run in which the files of system tests begin: none of them ends it alone.
_SYSTEM_PART = 0.7


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that hold slow tests, and spread those that wait for nodes over them."""
    slow: set[Path] = {item.path for item in items if item.get_closest_marker("slow")}
    waiting: set[Path] = {item.path for item in items if item.get_closest_marker("system")}
    place: dict[Path, float] = {}
    for of_kind, part in ((waiting, _SYSTEM_PART), ({item.path for item in items} - waiting, 1.0)):
        files = dict.fromkeys(item.path for item in items if item.path in of_kind)
        in_order = sorted(files, key=lambda path: path not in slow)
        place |= {path: part * number / len(files) for number, path in enumerate(in_order)}
    items.sort(key=lambda item: place[item.path])
