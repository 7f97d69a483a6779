"""The board's clock and the machine's are two: the loop must follow the board's."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import pytest

from flexarm_core.signals import Command
from flexarm_daq.loop import acquisition
from flexarm_daq.loop.acquisition import Acquisition
from flexarm_daq.loop.limiter import arm_gate
from flexarm_daq.loop.sensor_check import SensorCheck
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from support.exhaustive import first_of
from support.nidaq_board import Board, VirtualClock
from support.nidaqmx_double import NidaqmxDouble

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_daq.loop.exchange import Record

RATE_HZ = 500.0
REPLY_S = 4e-4
STALL_S = 0.0101


class MachineClock:
    """Stands in for the module `time`."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += max(0.0, seconds)


class BoardClock(VirtualClock):
    """The same time, counted by another quartz."""

    def __init__(self, machine: MachineClock, drift: float) -> None:
        super().__init__()
        self._machine = machine
        self._pace = 1.0 + drift

    def __call__(self) -> float:
        return self._machine.now_s * self._pace

    def sleep(self, seconds: float) -> None:
        self._machine.sleep(seconds / self._pace)


class Controller:
    """Answers every sample after the same time; the machine stalls once."""

    def __init__(self, machine: MachineClock, stall_at: int = 0) -> None:
        self._machine = machine
        self._stall_at = stall_at
        self._pending: Iterator[int] = iter(())
        self.late_s: list[float] = []
        self.records: list[Record] = []

    def publish(self, record: Record) -> None:
        self.records.append(record)
        self._pending = iter([record.sequence])
        if record.sequence == self._stall_at:
            self._machine.sleep(STALL_S)

    def wait(self, timeout_s: float) -> Command | None:
        sequence = next(self._pending, None)
        if sequence is None or timeout_s < REPLY_S:
            # Wakes a little late, as a machine does, and so never for ever.
            self._machine.sleep(timeout_s + 1e-6)
            return None
        self._machine.sleep(REPLY_S)
        return Command(sequence, sequence, (0.5,), (0.0,), 1)

    def commanders(self) -> list[str]:
        """Return nothing: nobody is asked for."""
        return []

    def acted(self) -> None:
        """Do nothing: nothing waits."""

    def spare_time(self) -> None:
        """Do nothing."""


def run(monkeypatch: pytest.MonkeyPatch, drift: float, stall_at: int = 0) -> Acquisition:
    machine = MachineClock()
    monkeypatch.setattr(acquisition, "time", machine)
    rig = NidaqRig(
        NidaqSettings(rate_hz=RATE_HZ),
        nidaqmx=NidaqmxDouble(Board(clock=BoardClock(machine, drift))),
    )
    loop = Acquisition(
        rig,
        arm_gate(),
        Watchdog(1.0 / RATE_HZ),
        SensorCheck(RATE_HZ),
        Controller(machine, stall_at),
        rate_hz=RATE_HZ,
        samples=2000,
        paced_by_rig=True,
    )
    loop.run(threading.Event())
    return loop


@pytest.mark.parametrize("drift", first_of([-1e-2, -1e-4, 0.0, 1e-4, 1e-2], 2))
@pytest.mark.slow
def test_clocks_drift_apart___every_sample_is_taken_and_answered(
    monkeypatch: pytest.MonkeyPatch, drift: float
) -> None:
    loop = run(monkeypatch, drift)
    assert loop.sequence == 2000
    assert loop.missed == 0
    assert loop.unanswered == 0


@pytest.mark.parametrize("drift", [-1e-3, 0.0, 1e-3])
def test_rate___that_the_board_keeps___is_no_complaint(
    monkeypatch: pytest.MonkeyPatch, drift: float
) -> None:
    assert run(monkeypatch, drift).off_rate == ""


def test_rate___of_a_board_that_is_too_fast___is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    reported = run(monkeypatch, 1e-2).off_rate
    assert reported == "505.0 Hz by the machine's clock, for rate_hz = 500"


def test_machine_stalls___lost_samples_are_counted_and_the_loop_is_in_phase_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop = run(monkeypatch, 0.0, stall_at=100)
    # Of the five that came meanwhile, the newest was taken.
    assert loop.missed == 4
    # Back in phase: nobody waits longer than the machine takes.
    assert loop.late_s.percentiles().p50 == pytest.approx(0.0, abs=1e-5)
