from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

import pytest

from flexarm_core import clock
from flexarm_core.clock import Patience, slowness

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file in which the machine tells its load, of two cores."""
    file = tmp_path / "loadavg"
    monkeypatch.setattr(clock, "_LOAD", file)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    return file


@pytest.mark.parametrize(("runnable", "times"), [(0, 1.0), (1, 1.0), (2, 1.0), (20, 10.0)])
def test_slowness___is_that_of_the_threads_on_a_core(
    machine: Path, runnable: int, times: float
) -> None:
    machine.write_text(f"0.10 9.00 0.30 {runnable}/345 6789\n")
    assert slowness() == pytest.approx(times)


def test_slowness___that_no_file_says___is_that_of_the_last_minute(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not machine.exists()
    monkeypatch.setattr(os, "getloadavg", lambda: (8.0, 1.0, 1.0))
    assert slowness() == pytest.approx(4.0)


def test_patience___counts_time_by_the_share_of_a_core(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    waiting = Patience(5.0)
    machine.write_text("0 0 0 20/345 1\n")
    now_s = 140.0
    assert not waiting.is_over
    machine.write_text("0 0 0 1/345 1\n")
    now_s = 140.9
    assert not waiting.is_over
    now_s = 141.1
    assert waiting.is_over
    assert waiting.waited_s == pytest.approx(41.1)
