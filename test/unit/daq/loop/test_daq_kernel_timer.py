"""Timer of the kernel: when it goes off, and that the waiting thread leaves Python to others."""

from __future__ import annotations

import threading
import time

import pytest

from flexarm_daq.loop import deadman
from flexarm_daq.loop.deadman import KernelTimer

PATIENCE_S = 60.0


def test_wait___ends_after_the_time_and_not_before() -> None:
    timer = KernelTimer()
    for after_s in (0.0, 0.05):
        begun_s = time.monotonic()
        timer.set(after_s)
        timer.wait()
        assert time.monotonic() - begun_s >= after_s
    timer.close()


def test_set___once_more___takes_the_place_of_the_former_time() -> None:
    timer = KernelTimer()
    gone_off = threading.Event()
    timer.set(PATIENCE_S)

    def wait() -> None:
        timer.wait()
        gone_off.set()

    waiting = threading.Thread(target=wait)
    waiting.start()
    assert not gone_off.wait(0.05)
    timer.set(0.01)
    assert gone_off.wait(PATIENCE_S)
    waiting.join()
    timer.close()


def test_kernel_without_timers___is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deadman, "_TFD_CLOEXEC", -1)
    with pytest.raises(OSError, match="Invalid argument"):
        KernelTimer()
