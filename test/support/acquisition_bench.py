"""Acquisition between doubles of rig and link, on a clock that only waiting moves."""

from __future__ import annotations

import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.signals import Command
from flexarm_daq.loop.acquisition import Acquisition, LockStep
from flexarm_daq.loop.limiter import LimiterSettings, arm_gate
from flexarm_daq.loop.sensor_check import SensorCheck, SensorLimits
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.rigs.rig_protocol import RigError, RigSample

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flexarm_daq.loop.exchange import Record

# A power of two: sums of periods are exact.
RATE_HZ = 256.0
PERIOD_S = 1.0 / RATE_HZ
WIDE = LimiterSettings(max_slew_v_per_s=1e6)
TIMEOUT_S = 1.0
FAST = LockStep(0.0, TIMEOUT_S, is_answered=True)
# The double's readings belong to no arm: they never change, or jump.
NO_NOISE = SensorLimits(stuck_samples=0, disagreement_rad=1e3)
# A wait is over a little late, so that it never ends just before its end by rounding.
WAKE_UP_S = 1e-9


class Clock:
    """Clock that moves only when somebody waits."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now_s += seconds


class LoggingRig:
    """Rig that notes every call with its instant; in virtual time sample k stands at k periods."""

    def __init__(self, clock: Clock, *, virtual: bool) -> None:
        self.calls: list[tuple[str, float]] = []
        self.writes: list[float] = []
        self.read_times_s: list[float] = []
        self.write_times_s: list[float] = []
        self.slow_reads_s: dict[int, float] = {}
        self.fails_at: int | None = None
        self.position_v = 0.0
        self.reports: dict[int, tuple[float, ...]] = {}
        self._clock = clock
        self._virtual = virtual
        self._start_s = clock.now_s

    def open(self) -> None:
        self.calls.append(("open", 0.0))

    def read(self) -> RigSample:
        count = len(self.read_times_s)
        if count == self.fails_at:
            raise RigError("a wire broke")
        time_s = count * PERIOD_S if self._virtual else self._clock.now_s - self._start_s
        self.calls.append(("read", time_s))
        self.read_times_s.append(time_s)
        self._clock.now_s += self.slow_reads_s.get(count, 0.0)
        readings = np.array([self.position_v, 0.1, 0.2, 0.3])
        return RigSample(time_s, readings, self.reports.get(count))

    def write(self, commands: Sequence[float]) -> None:
        (command_v,) = commands
        self.calls.append(("write", command_v))
        self.writes.append(command_v)
        self.write_times_s.append(self._clock.now_s - self._start_s)

    def safe_stop(self) -> None:
        self.calls.append(("safe_stop", 0.0))

    def close(self) -> None:
        self.calls.append(("close", 0.0))


class ScriptedLink:
    """Link that answers every record with commands that arrive after their delays."""

    def __init__(
        self, clock: Clock, answer: Callable[[Record], Sequence[tuple[float, Command]]]
    ) -> None:
        self.records: list[Record] = []
        self.spare_times_s: list[float] = []
        self.spared: list[int] = []
        self._clock = clock
        self._start_s = clock.now_s
        self._answer = answer
        self._coming: list[tuple[float, Command]] = []

    def publish(self, record: Record) -> None:
        self.records.append(record)
        for delay_s, command in self._answer(record):
            self._coming.append((self._clock.now_s + delay_s, command))

    def wait(self, timeout_s: float) -> Command | None:
        until_s = self._clock.now_s + max(timeout_s, 0.0)
        if self._coming and self._coming[0][0] <= until_s:
            arrival_s, command = self._coming.pop(0)
            self._clock.now_s = max(self._clock.now_s, arrival_s)
            return command
        if timeout_s > 0.0:
            self._clock.now_s = until_s + WAKE_UP_S
        return None

    def commanders(self) -> list[str]:
        return ["/flexarm/controller", "/flexarm/other"]

    def acted(self) -> None:
        """Do nothing: nothing waits."""

    def spare_time(self) -> None:
        self.spare_times_s.append(self._clock.now_s - self._start_s)
        self.spared.append(self.records[-1].sequence)


class Bench:
    """Acquisition between doubles, on a clock of its own."""

    def __init__(
        self,
        clock: Clock,
        answer: Callable[[Record], Sequence[tuple[float, Command]]],
        *,
        virtual: bool,
        samples: int,
        limits: LimiterSettings = WIDE,
        max_age_periods: int = 3,
        lockstep: LockStep = FAST,
    ) -> None:
        self.rig = LoggingRig(clock, virtual=virtual)
        self.link = ScriptedLink(clock, answer)
        self.watchdog = Watchdog(PERIOD_S, max_age_periods)
        self.acquisition = Acquisition(
            self.rig,
            arm_gate(limits),
            self.watchdog,
            SensorCheck(RATE_HZ, NO_NOISE),
            self.link,
            rate_hz=RATE_HZ,
            samples=samples,
            lockstep=lockstep if virtual else None,
        )

    def run(self) -> Bench:
        self.acquisition.run(threading.Event())
        return self

    def run_until(self, stop: threading.Event) -> None:
        """Run; an error of the rig is part of the experiment."""
        with suppress(RigError):
            self.acquisition.run(stop)

    @property
    def commands_v(self) -> list[float]:
        return [record.commands[0] for record in self.link.records]


def reply(record: Record, effort_v: float, compensation_v: float = 0.0) -> Command:
    return Command(1000 + record.sequence, record.sequence, (effort_v,), (compensation_v,))


def at_once(effort_v: Callable[[Record], float]) -> Callable[[Record], list[tuple[float, Command]]]:
    return lambda record: [(0.0, reply(record, effort_v(record)))]


def never(_: Record) -> list[tuple[float, Command]]:
    return []


@contextmanager
def acquisition_clock() -> Iterator[Clock]:
    """Let the acquisition go by a new clock, also within one example of a property test."""
    with pytest.MonkeyPatch.context() as patch:
        made = Clock()
        patch.setattr("flexarm_daq.loop.acquisition.time", made)
        yield made
