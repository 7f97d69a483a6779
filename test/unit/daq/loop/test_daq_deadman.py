"""Dead man's switch: a law that holds up the sampling thread does not drive the arm."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.signals import Command
from flexarm_daq.loop.acquisition import Acquisition
from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.deadman import Deadman
from flexarm_daq.loop.limiter import arm_gate
from flexarm_daq.loop.safety import DriveState, Event
from flexarm_daq.loop.sensor_check import SensorCheck
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.rigs.rig_protocol import RigSample

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_daq.loop.exchange import Record

PATIENCE_S = 60.0
RATE_HZ = 10.0
HANGS_AT = 5


class Rig:
    """Rig that notes what the drive is told, and by which thread."""

    def __init__(self) -> None:
        self.drive_v = 0.0
        self.stopped = threading.Event()
        self.stopped_by: list[int] = []
        self._start_s = time.monotonic()

    def open(self) -> None:
        """Do nothing."""

    def read(self) -> RigSample:
        time_s = time.monotonic() - self._start_s
        return RigSample(time_s, np.array([0.1, 0.1, 0.2, 0.3]) * (1.0 + time_s % 0.1))

    def write(self, commands: Sequence[float]) -> None:
        (command_v,) = commands
        self.drive_v = command_v

    def safe_stop(self) -> None:
        self.drive_v = 0.0
        self.stopped_by.append(threading.get_ident())
        self.stopped.set()

    def close(self) -> None:
        """Do nothing."""


class HangingLaw:
    """Law in the thread of the loop that hangs once in some work, until the drive is at zero."""

    def __init__(self, rig: Rig, work: str) -> None:
        self._rig = rig
        self._work = work
        self._answer: Command | None = None
        self.sequences: list[int] = []
        self.before_v = 0.0
        self.after_v: list[float] = []

    def publish(self, record: Record) -> None:
        self.sequences.append(record.sequence)
        if len(self.sequences) > HANGS_AT:
            self.after_v.append(self._rig.drive_v)
        self._hang("answer")
        number = len(self.sequences)
        self._answer = Command(number, record.sequence, (0.5,), (0.0,), number)

    def wait(self, timeout_s: float) -> Command | None:
        answer, self._answer = self._answer, None
        if answer is None:
            time.sleep(timeout_s)
        return answer

    def commanders(self) -> list[str]:
        """Return nothing: nobody is asked for."""
        return []

    def acted(self) -> None:
        self._hang("rest of the answer")

    def spare_time(self) -> None:
        self._hang("report")

    def _hang(self, work: str) -> None:
        is_time = len(self.sequences) >= HANGS_AT and not self._rig.stopped.is_set()
        if work == self._work and is_time:
            self.before_v = self._rig.drive_v
            assert self._rig.stopped.wait(PATIENCE_S)


@pytest.mark.parametrize("work", ["answer", "rest of the answer", "report"])
def test_law_that_hangs___drive_is_at_zero_meanwhile___and_is_driven_by_the_next_answer(
    work: str,
) -> None:
    rig = Rig()
    reported: list[float] = []
    law = HangingLaw(rig, work)
    watchdog = Watchdog(1.0 / RATE_HZ)
    loop = Acquisition(
        rig,
        arm_gate(),
        watchdog,
        SensorCheck(RATE_HZ),
        law,
        rate_hz=RATE_HZ,
        samples=14,
        deadman=Deadman(watchdog.longest_answer_s, rig.safe_stop, reported.append),
    )

    loop.run(threading.Event())

    assert law.before_v == pytest.approx(0.5)
    assert rig.stopped_by[0] != threading.get_ident()
    if work == "answer":
        assert loop.commander.verdicts[Verdict.LATE] >= 1
    assert loop.safety.counts[Event.STALE] >= 1
    assert loop.missed >= 1
    assert law.after_v[0] == pytest.approx(0.0)
    assert max(law.after_v) == pytest.approx(0.5)
    assert loop.safety.state is DriveState.OFF


def test_answer_that_takes_long___is_reported_once_a_second() -> None:
    released, reported = threading.Event(), threading.Event()
    with Deadman(0.05, released.set, lambda _: reported.set()) as deadman:
        deadman.begin()
        assert released.wait(PATIENCE_S)
        assert reported.wait(PATIENCE_S)
        assert deadman.end()
        assert deadman.has_released()
        assert not deadman.has_released()


def test_answer_in_time___changes_nothing() -> None:
    with Deadman(PATIENCE_S, lambda: pytest.fail("released"), lambda _: None) as deadman:
        for _ in range(3):
            deadman.begin()
            assert not deadman.end()
        assert not deadman.has_released()


def test_answer_that_never_comes___is_reported_again_in_each_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    second_s = 0.1
    monkeypatch.setattr("flexarm_daq.loop.deadman._REPORT_S", second_s)
    thrice, reported = threading.Event(), []

    def report(passed_s: float) -> None:
        reported.append(passed_s)
        if len(reported) == 3:
            thrice.set()

    with Deadman(0.01, lambda: None, report) as deadman:
        deadman.begin()
        assert thrice.wait(PATIENCE_S)
        deadman.end()

    assert np.diff([0.0, *reported[:3]]).min() > second_s
