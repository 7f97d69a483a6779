"""Exchange with the rig: a sample out, a command in, and a safe drive.

The exchange reads no clock: its caller states the time (`flexarm_daq.loop.acquisition`).
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flexarm_daq.loop.commander import Commander, Verdict
from flexarm_daq.loop.safety import DriveState, Event, Safety
from flexarm_daq.rigs.rig_protocol import RigError
from flexarm_node.statistics import Window

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import numpy as np
    from numpy.typing import NDArray

    from flexarm_core.signals import Command
    from flexarm_daq.loop.deadman import Deadman
    from flexarm_daq.loop.limiter import Gate, InputLimits
    from flexarm_daq.loop.sensor_check import SensorCheck
    from flexarm_daq.loop.watchdog import Watchdog
    from flexarm_daq.rigs.rig_protocol import Rig, RigSample


class Applied(NamedTuple):
    """Commands in force behind the gate, and the number of their command."""

    commands: tuple[float, ...]
    compensations: tuple[float, ...]
    command_sequence: int

    def as_reported(self, commands: tuple[float, ...] | None) -> Applied:
        """Return what is in force by the rig's own account, if it has one: a board drops some."""
        if commands is None:
            return self
        pairs = zip(commands, self.compensations, strict=True)
        return Applied(
            commands, tuple(part if each else 0.0 for each, part in pairs), self.command_sequence
        )


class Record(NamedTuple):
    """One sample with the command in force while it was taken.

    `sequence` is the number of its period, from 1. `time_s` is the rig's time, `taken_s` that of
    the monotonic clock.
    """

    sequence: int
    time_s: float
    taken_s: float
    outputs: NDArray[np.float64]
    commands: tuple[float, ...]
    compensations: tuple[float, ...]
    command_sequence: int

    def start_ns(self, now_ns: int, now_s: float) -> int:
        """Return the start of the rig's time on another clock, given both clocks at one instant."""
        return now_ns - round((now_s - self.taken_s + self.time_s) * 1e9)


class Link(Protocol):
    """Far end of the loop: samples go there, commands come from there."""

    def publish(self, record: Record) -> None:
        """Publish one sample."""

    def wait(self, timeout_s: float) -> Command | None:
        """Return the newest command, or None when none came in time."""

    def commanders(self) -> list[str]:
        """Return the full names of the nodes that may have sent a command."""

    def acted(self) -> None:
        """Do what has waited for the answer to a sample: it has acted, or was refused."""

    def spare_time(self) -> None:
        """Do short work that can wait.

        It is called after the answer to a sample or in the wait for it, at the latest in every
        second period.
        """


class Exchange:
    """Treatment of every sample and every command of one run.

    Parameters
    ----------
    rig : Rig
        Rig under control.
    gate : Gate
        Limits of the commands, last before the rig.
    watchdog : Watchdog
        Check of the command's age.
    sensors : SensorCheck
        Check of the sensors.
    link : Link
        Far end of the loop.
    rate_hz : float
        Sampling rate, Hz.
    statistics_s : float
        Time that `reply_s` looks back, s.
    deadman : Deadman, optional
        Switch for a link that answers in the thread of the loop.

    Attributes
    ----------
    safety : Safety
        State of the drive.
    commander : Commander
        Commander in force, and the verdicts on its commands.
    applied : Applied
        Commands in force.
    sequence : int
        Number of the newest sample: that of its period, from 1 on.
    taken, missed, unanswered : int
        Samples taken, whole periods skipped, and samples without an answer before the next sample.
    limited : int
        Commands that the limiter changed.
    limited_by : Counter of str
        Number of times that each limit of the limiter acted.
    held_s : float
        Time of the run at which the drive was held or the run failed, s; NaN before.
    reply_s : Window
        Time from a sample to its command, s; whole periods between them count as such.
    """

    def __init__(
        self,
        rig: Rig,
        gate: Gate,
        watchdog: Watchdog,
        sensors: SensorCheck,
        link: Link,
        *,
        rate_hz: float,
        statistics_s: float = 10.0,
        deadman: Deadman | None = None,
    ) -> None:
        self._rig = rig
        self._gate = gate
        self._at_rest = Applied(gate.rest, (0.0,) * len(gate.rest), 0)
        self._watchdog = watchdog
        self._sensors = sensors
        self._link = link
        self._deadman = deadman
        self._overdue = 0
        self._period_s = 1.0 / rate_hz
        self._emergency = False
        self._outputs: NDArray[np.float64] | None = None
        self.applied = self._at_rest
        self._tick_s = 0.0
        self._sample_time_s = -math.inf
        self._started_s = (math.nan, math.nan)
        self.safety = Safety()
        self.commander = Commander()
        self.sequence = 0
        self.taken = 0
        self.missed = 0
        self.unanswered = 0
        self.limited = 0
        self.limited_by: Counter[str] = Counter()
        self.held_s = math.nan
        self.reply_s = Window(max(1, round(statistics_s * rate_hz)))

    @property
    def refused(self) -> int:
        """Commands that were refused for their sender or for the sample that they answer."""
        return self.commander.verdicts.total() - self.commander.verdicts[Verdict.ACCEPTED]

    @property
    def real_time_factor(self) -> float:
        """Ratio of the rig's time to that of the wall clock; NaN before the second sample."""
        # Another thread may read between two assignments: the ratio is for information only.
        passed_s, of_rig_s = self._passed_s()
        return of_rig_s / passed_s if passed_s > 0.0 else math.nan

    def _passed_s(self) -> tuple[float, float]:
        """Return the time since the first sample by the machine's clock and by the rig's, s."""
        time_s, tick_s = self._started_s
        return self._tick_s - tick_s, self._sample_time_s - time_s

    def limit(self, limits: Iterable[InputLimits]) -> None:
        """Take other limits from the next command on; any thread may call."""
        self._gate.limits = limits

    def emergency_stop(self) -> None:
        """Hold the drive at zero from the next tick to the end of the run; any thread may call."""
        self._emergency = True

    def _read(self) -> RigSample:
        """Sample the rig.

        Raises
        ------
        RigError
            When the rig fails, a channel is missing, or the rig's clock stands still.
        """
        sample = self._rig.read()
        read, wanted = len(sample.outputs), self._sensors.outputs
        if read != wanted:
            raise RigError(f"short reading: {read} of {wanted} channels, check the board")
        if not sample.time_s > self._sample_time_s:
            raise RigError(
                f"the rig's clock stands still after {sample.time_s:.4f} s, check the board"
            )
        return sample

    def _take(self, sample: RigSample, now_s: float, skipped: int = 0) -> None:
        """Take a sample that is some whole periods late, and publish it."""
        self._tick_s = now_s
        if self.commander.answered != self.sequence:
            self.unanswered += 1
        self.missed += skipped
        self.sequence += 1 + skipped
        self.taken += 1
        in_force = self.applied.as_reported(sample.commands)
        self._end_by_time(sample.time_s)
        self._outputs = sample.outputs
        self._sample_time_s = sample.time_s
        if self.taken == 1:
            self._started_s = (sample.time_s, now_s)
        record = Record(self.sequence, sample.time_s, now_s, sample.outputs, *in_force)
        self._watched(lambda: self._link.publish(record))
        # A controller in another process works while the readings are examined.
        if complaint := self._sensors.complaint(sample.time_s, sample.outputs):
            self._hold(Event.SENSOR_FAULT, complaint)
            self._let_go()

    def _watched(self, work: Callable[[], None]) -> None:
        """Let the link work, in this thread maybe for the law; it may hang there.

        An answer that took too long is not obeyed.
        """
        if self._deadman is None:
            work()
            return
        self._deadman.begin()
        work()
        if self._deadman.end():
            self._overdue = self.sequence
        if self._deadman.has_released():
            self._lose_commander()

    def _act(self, command: Command, now_s: float) -> Verdict:
        """Let a command act if it may; return the verdict on it."""
        answered = command.state_sequence
        in_time = answered != self._overdue and self._watchdog.in_time(answered)
        verdict = self.commander.judge(command, self.sequence, in_time=in_time)
        if verdict is Verdict.CONFLICT:
            self._write(self._at_rest)
            # They may go on for ever, and each look at the graph would hold up the loop.
            if self.safety.state is not DriveState.HELD:
                self._hold(Event.TWO_COMMANDERS, self._two_commanders(command))
        if verdict is not Verdict.ACCEPTED:
            return verdict
        self._watchdog.fed(command.state_sequence)
        behind = self.sequence - command.state_sequence
        self.reply_s.add(now_s - self._tick_s + behind * self._period_s)
        if self._emergency:
            return verdict
        self.safety.on(Event.COMMAND)
        if not self.safety.driving or self._outputs is None:
            return verdict
        limited = self._gate.apply(
            command.efforts, command.compensations, self._outputs.tolist(), self._period_s
        )
        self.limited += bool(limited.reasons)
        self.limited_by.update(limited.reasons)
        self._write(Applied(limited.commands, limited.compensations, command.sequence))
        return verdict

    def _two_commanders(self, command: Command) -> str:
        """Return who may have sent a command: one that ends is not known when somebody looks."""
        senders = ", ".join(self._link.commanders()) or "nodes that are not known"
        return (
            f"two commanders: command {command.sequence} for sample {command.state_sequence} "
            f"is not the only one; who may command: {senders}"
        )

    def _lose_commander(self) -> None:
        """Take the drive to zero, since the commander in force is silent."""
        self.commander.release()
        self.safety.on(Event.STALE)
        self._let_go()

    def _let_go(self) -> None:
        """Take the drive to zero if it is not there; the next command starts from zero."""
        if self.applied != self._at_rest:
            self._write(self._at_rest)
            self._gate.reset()

    def _hold(self, event: Event, reason: str) -> None:
        """Take an event that ends the driving for good, and note the time of the first."""
        self.safety.on(event, reason)
        if math.isnan(self.held_s) and self.safety.reason:
            self.held_s = max(0, self.sequence - 1) * self._period_s

    def _end_by_time(self, time_s: float) -> None:
        """Take the drive to zero after an emergency stop and when its commander is silent."""
        if self._emergency:
            self._hold(Event.EMERGENCY_STOP, "emergency stop")
        if self._watchdog.stale(self.sequence, time_s):
            self.commander.release()
            self.safety.on(Event.STALE)
        if not self.safety.driving:
            self._let_go()

    def _write(self, applied: Applied) -> None:
        self._rig.write(applied.commands)
        self.applied = applied
