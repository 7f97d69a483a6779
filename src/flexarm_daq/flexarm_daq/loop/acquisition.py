"""The sampling loop: read the rig, hand the sample out, let the answer act, keep the drive safe.

A command acts when it arrives, inside the period: a whole sample of delay makes the thesis's
control loops unstable. In real time the loop ticks on absolute deadlines and serves commands in
between; when it is late it skips whole periods and their numbers, it never bursts. In virtual time
it is lock-step: every sample waits for its answer, and the next one for the wall clock at the
run's pace. When the machine stalls the arm's time stalls with it: nothing is lost, and the same
seed gives the same numbers at any pace.

A sample waits only while somebody answers. When an answer does not come in time the drive goes to
zero, and the arm moves on at its pace until a command is accepted again.

Time is the rig's and the monotonic clock's: a jump of the wall clock changes nothing here.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flexarm_core.channels import CHANNELS
from flexarm_daq.loop.commander import Commander, Verdict
from flexarm_daq.loop.safety import Event, Safety
from flexarm_daq.rigs.rig_protocol import RigError
from flexarm_node.statistics import Window

if TYPE_CHECKING:
    import threading

    import numpy as np
    from numpy.typing import NDArray

    from flexarm_daq.loop.commander import Command
    from flexarm_daq.loop.limiter import Limiter, LimiterSettings
    from flexarm_daq.loop.sensor_check import SensorCheck
    from flexarm_daq.loop.watchdog import Watchdog
    from flexarm_daq.rigs.rig_protocol import Rig, RigSample

# The middleware's timed wait wakes up late; the rest of the period is slept.
_WAKE_MARGIN_S = 2e-4
# What is done in spare time usually takes less.
_SPARE_S = 3e-4
# In virtual time a sample may wait long for its answer, or for its pace; being told to stop must
# not, nor what is done in spare time.
_STOP_POLL_S = 0.05


class Applied(NamedTuple):
    """What the drive was told: volts after the limiter, and which command they come from."""

    command_v: float
    compensation_v: float
    command_sequence: int


class Record(NamedTuple):
    """One sample with the command in force while it was taken.

    `sequence` is the number of its period, from 1. `time_s` is the rig's time, `taken_s` the
    monotonic clock's.
    """

    sequence: int
    time_s: float
    taken_s: float
    volts: NDArray[np.float64]
    command_v: float
    compensation_v: float
    command_sequence: int

    def start_ns(self, now_ns: int, now_s: float) -> int:
        """Return when the rig's time began, on another clock.

        Parameters
        ----------
        now_ns : int
            What the other clock shows.
        now_s : float
            What the monotonic clock shows at the same instant.
        """
        return now_ns - round((now_s - self.taken_s + self.time_s) * 1e9)


_NOTHING = Applied(0.0, 0.0, 0)


class LockStep(NamedTuple):
    """How virtual time goes.

    Attributes
    ----------
    real_time_factor : float
        Pace: the arm's time for the wall clock's at best; 0 goes as fast as the answers come.
    answer_timeout_s : float
        How long a sample waits for its answer.
    is_answered : bool
        The first sample waits for its answer; else samples wait from the first command on.
    """

    real_time_factor: float
    answer_timeout_s: float
    is_answered: bool


class Link(Protocol):
    """Where samples go and commands come from."""

    def publish(self, record: Record) -> None:
        """Hand one sample out."""

    def wait(self, timeout_s: float) -> Command | None:
        """Return the newest command, or None when none came in time."""

    def spare_time(self) -> None:
        """Do what is short and can wait.

        Called after the answer to a sample, or else in the wait for it, at the latest in every
        second period.
        """


class Acquisition:
    """One run of the sampling loop.

    Parameters
    ----------
    rig, limiter, watchdog, sensors, link
        What is sampled, the last gate before it, the judge of the command's age, the judge of the
        sensors, and the far end.
    rate_hz
        Sampling rate.
    samples
        The run ends by itself after that many periods; 0 runs until it is stopped.
    paced_by_rig
        In real time: the rig's own clock says when a sample is due, and reading waits for it.
    lockstep
        How virtual time goes; None runs in real time.
    statistics_s
        How long `late_s` and `reply_s` look back.

    Attributes
    ----------
    safety : Safety
        State of the drive.
    commander : Commander
        Who is in force, and what became of the commands.
    sequence : int
        Number of the newest sample: of its period, from 1 on.
    taken : int
        Samples taken.
    missed : int
        Whole periods skipped.
    unanswered : int
        Samples whose answer had not come when the next one was taken.
    limited_by : Counter of str
        How often each limit of the limiter acted.
    late_s, reply_s : Window
        Lateness of the ticks, and time from a sample to its command.
    """

    def __init__(
        self,
        rig: Rig,
        limiter: Limiter,
        watchdog: Watchdog,
        sensors: SensorCheck,
        link: Link,
        *,
        rate_hz: float,
        samples: int = 0,
        paced_by_rig: bool = False,
        lockstep: LockStep | None = None,
        statistics_s: float = 10.0,
    ) -> None:
        self._rig = rig
        self._limiter = limiter
        self._watchdog = watchdog
        self._sensors = sensors
        self._link = link
        self._period_s = 1.0 / rate_hz
        self._samples = samples
        self._paced_by_rig = paced_by_rig
        self._lockstep = lockstep
        self._is_answered = lockstep is not None and lockstep.is_answered
        self._emergency = False
        self._spared = 0
        self._position_v = 0.0
        self._applied = _NOTHING
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
        size = max(1, round(statistics_s * rate_hz))
        self.late_s = Window(size)
        self.reply_s = Window(size)

    @property
    def refused(self) -> int:
        """Commands that were not obeyed because of where they come from or what they answer."""
        return self.commander.verdicts.total() - self.commander.verdicts[Verdict.ACCEPTED]

    @property
    def real_time_factor(self) -> float:
        """How fast the rig's time has passed since the first sample, for that of the wall clock.

        NaN before the second sample.
        """
        # Another thread may ask between two assignments: a figure, no more.
        time_s, tick_s = self._started_s
        passed_s = self._tick_s - tick_s
        return (self._sample_time_s - time_s) / passed_s if passed_s > 0.0 else math.nan

    def limit(self, settings: LimiterSettings) -> None:
        """Take other limits from the next command on; any thread may call."""
        self._limiter.settings = settings

    def emergency_stop(self) -> None:
        """Take the drive to zero at the next tick and keep it there until the run ends.

        Any thread may call.
        """
        self._emergency = True

    def run(self, stop: threading.Event) -> None:
        """Sample until told to stop or until all samples are taken; the drive ends at zero.

        Raises
        ------
        RigError
            When the rig fails; the drive has been told to stop before it is raised. The same holds
            for whatever else is raised.
        """
        try:
            self._rig.open()
            self.safety.on(Event.START)
            if self._lockstep is not None:
                self._run_in_lockstep(self._lockstep, stop)
            elif self._paced_by_rig:
                self._run_by_the_rig(stop)
            else:
                self._run_by_the_clock(stop)
        except BaseException as error:
            self._rig.safe_stop()
            self.safety.on(Event.FAILURE, str(error))
            raise
        finally:
            self._rig.safe_stop()
            self.safety.on(Event.END)
            self._rig.close()

    def _run_by_the_clock(self, stop: threading.Event) -> None:
        deadline_s = time.monotonic()
        skipped = 0
        while not stop.is_set():
            self._take(self._read(), skipped)
            if self._is_last():
                return
            deadline_s += self._period_s
            late_s = self._serve_until(deadline_s, stop)
            skipped = max(0, int(late_s / self._period_s))
            deadline_s += skipped * self._period_s

    def _run_by_the_rig(self, stop: threading.Event) -> None:
        while not stop.is_set():
            sample = self._read()
            periods = (sample.time_s - self._sample_time_s) / self._period_s if self.taken else 1.0
            self._take(sample, max(0, round(periods) - 1))
            if self._is_last():
                return
            # A little early, so that lateness does not stay: reading waits out the rest.
            self._serve_until(self._tick_s + self._period_s - _WAKE_MARGIN_S, stop)

    def _run_in_lockstep(self, lockstep: LockStep, stop: threading.Event) -> None:
        deadline_s = time.monotonic()
        while not stop.is_set():
            self._take(self._read())
            if self._is_last():
                return
            if self._is_answered:
                self._await_answer(lockstep.answer_timeout_s, stop)
            # Without a pace, samples that nobody answers would run away from who comes to answer.
            pace = lockstep.real_time_factor or (0.0 if self._is_answered else 1.0)
            if not pace:
                deadline_s = time.monotonic()
                continue
            period_s = self._period_s / pace
            deadline_s += period_s
            late_s = self._serve_until(deadline_s, stop)
            if late_s > period_s:
                deadline_s += late_s

    def _is_last(self) -> bool:
        return bool(self._samples) and self.sequence >= self._samples

    def _read(self) -> RigSample:
        sample = self._rig.read()
        self._require_whole(sample)
        return sample

    def _take(self, sample: RigSample, skipped: int = 0) -> None:
        """Take a sample, so many whole periods too late, and hand it out."""
        self._tick_s = time.monotonic()
        if self.commander.answered != self.sequence:
            self.unanswered += 1
        in_force = self._applied
        self._look_for_faults(sample)
        if not self.safety.driving:
            self._let_go()
        self.missed += skipped
        self.sequence += 1 + skipped
        self.taken += 1
        self._position_v = float(sample.volts[0])
        self._sample_time_s = sample.time_s
        if self.taken == 1:
            self._started_s = (sample.time_s, self._tick_s)
        self._link.publish(
            Record(self.sequence, sample.time_s, self._tick_s, sample.volts, *in_force)
        )

    def _require_whole(self, sample: RigSample) -> None:
        if len(sample.volts) != len(CHANNELS):
            raise RigError(
                f"short reading: {len(sample.volts)} of {len(CHANNELS)} channels, check the board"
            )
        if not sample.time_s > self._sample_time_s:
            raise RigError(
                f"the rig's clock does not go on after {sample.time_s:.4f} s, check the board"
            )

    def _look_for_faults(self, sample: RigSample) -> None:
        complaint = self._sensors.complaint(sample.time_s, sample.volts)
        if complaint:
            self.safety.on(Event.SENSOR_FAULT, complaint)
        if self._emergency:
            self.safety.on(Event.EMERGENCY_STOP, "emergency stop")
        if self._watchdog.stale(sample.time_s):
            self.commander.release()
            self.safety.on(Event.STALE)

    def _serve_until(self, deadline_s: float, stop: threading.Event) -> float:
        """Let commands act until a deadline, and return how late it has become."""
        if self._spared < self.taken - 1:
            self._spare()
        while not stop.is_set():
            left_s = deadline_s - time.monotonic()
            if left_s <= _WAKE_MARGIN_S:
                time.sleep(max(0.0, left_s))
                self._serve_the_last()
                break
            command = self._link.wait(min(left_s - _WAKE_MARGIN_S, _STOP_POLL_S))
            if command is not None:
                self._act(command)
            left_s = deadline_s - time.monotonic()
            is_done = command is None or self.commander.answered == self.sequence
            if is_done and left_s > _SPARE_S:
                self._spare()
        late_s = time.monotonic() - deadline_s
        self.late_s.add(late_s)
        return late_s

    def _spare(self) -> None:
        self._spared = self.taken
        self._link.spare_time()

    def _serve_the_last(self) -> None:
        """Let an answer act that came in the sleep before the next sample."""
        if self.commander.answered == self.sequence:
            return
        command = self._link.wait(0.0)
        if command is not None:
            self._act(command)

    def _await_answer(self, timeout_s: float, stop: threading.Event) -> None:
        until_s = time.monotonic() + timeout_s
        while self.commander.answered != self.sequence and not stop.is_set():
            self._spare()
            left_s = until_s - time.monotonic()
            command = self._link.wait(min(left_s, _STOP_POLL_S))
            if command is not None:
                self._act(command)
            elif left_s <= _STOP_POLL_S:
                self._give_up_on_the_commander()
                return

    def _give_up_on_the_commander(self) -> None:
        self._is_answered = False
        self.commander.release()
        self.safety.on(Event.STALE)
        self._let_go()

    def _let_go(self) -> None:
        """Take the drive to zero, if it is not there; the next command starts from zero."""
        if self._applied != _NOTHING:
            self._write(_NOTHING)
            self._limiter.reset()

    def _act(self, command: Command) -> None:
        verdict = self.commander.judge(command, self.sequence)
        if verdict is Verdict.CONFLICT:
            self.safety.on(
                Event.TWO_COMMANDERS,
                f"two commanders: command {command.sequence} for sample {command.state_sequence} "
                "is not the only one",
            )
            self._write(_NOTHING)
        if verdict is not Verdict.ACCEPTED:
            return
        self._is_answered = True
        self._watchdog.fed(self._sample_time_s)
        self.reply_s.add(time.monotonic() - self._tick_s)
        if self._emergency:
            return
        self.safety.on(Event.COMMAND)
        if not self.safety.driving:
            return
        limited = self._limiter.apply(
            command.effort_v, command.compensation_v, self._position_v, self._period_s
        )
        self.limited += bool(limited.reasons)
        self.limited_by.update(limited.reasons)
        self._write(Applied(limited.command_v, limited.compensation_v, command.sequence))

    def _write(self, applied: Applied) -> None:
        self._rig.write(applied.command_v)
        self._applied = applied
