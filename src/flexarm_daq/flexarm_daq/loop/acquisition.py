"""Sampling loop in real or virtual time, with the drive at zero before and after.

A command acts when it arrives, inside the period: a delay of a whole sample makes the thesis's
control loops unstable. In real time the loop ticks on absolute deadlines and serves commands in
between. When it is late, it skips whole periods and their numbers and never bursts.

In virtual time the loop is lock-step: every sample waits for its answer, and the next sample waits
for the wall clock at the pace of the run. A stalled machine therefore stalls the arm's time too,
and no sample is lost. The same seed gives the same numbers at any pace.

A sample waits only while a commander answers. When an answer is too late, the drive goes to zero.
The arm then moves on at its pace until a command is accepted again, and so it does while the drive
is held.

Time comes from the rig and from the monotonic clock, so a jump of the wall clock has no effect.
"""

from __future__ import annotations

import time
from contextlib import nullcontext
from typing import TYPE_CHECKING, NamedTuple

from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.exchange import Exchange
from flexarm_daq.loop.safety import DriveState, Event
from flexarm_daq.rigs.rig_protocol import OFF_RATE
from flexarm_node.statistics import Window

if TYPE_CHECKING:
    import threading

    from flexarm_core.clock import Clock
    from flexarm_daq.loop.deadman import Deadman
    from flexarm_daq.loop.exchange import Link
    from flexarm_daq.loop.limiter import Gate
    from flexarm_daq.loop.sensor_check import SensorCheck
    from flexarm_daq.loop.watchdog import Watchdog
    from flexarm_daq.rigs.rig_protocol import Rig

# The timed wait of the middleware wakes up late, so the last part of a period is slept.
_WAKE_MARGIN_S = 2e-4
# Work in spare time usually takes less than this.
_SPARE_S = 3e-4
# In virtual time a sample may wait long for its answer or its pace. A stop and the work in spare
# time must not wait that long.
_STOP_POLL_S = 0.05
# A rate that is off shows when the times differ by more than the jitter.
_OFF_S = 0.01
_REPORT_S = 1.0
_CLOCKS = ("the machine's clock", "the rig's clock")


class LockStep(NamedTuple):
    """Settings of virtual time.

    Attributes
    ----------
    real_time_factor : float
        Largest ratio of the arm's time to that of the wall clock; 0 goes as fast as the answers
        come.
    answer_timeout_s : float
        Longest wait of a sample for its answer, s.
    is_answered : bool
        True: the first sample waits for its answer. False: samples wait from the first command on.
    """

    real_time_factor: float
    answer_timeout_s: float
    is_answered: bool


class Acquisition(Exchange):
    """One run of the sampling loop: an exchange in real or in virtual time.

    Parameters
    ----------
    rig, gate, watchdog, sensors, link, rate_hz
        See `Exchange`.
    samples : int
        Number of periods after which the run ends; 0 runs until it is stopped.
    paced_by_rig : bool
        In real time: reading waits for the rig's own clock, which sets the sampling instants.
    lockstep : LockStep or None
        Settings of virtual time; None runs in real time.
    statistics_s : float
        Time that `late_s` and `reply_s` look back, s.
    deadman : Deadman, optional
        Switch for a link that answers in the thread of the loop, in real time.
    clock : Clock, optional
        Clock of the loop, by default that of the machine.

    Attributes
    ----------
    late_s : Window
        Lateness of the ticks, s.
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
        samples: int = 0,
        paced_by_rig: bool = False,
        lockstep: LockStep | None = None,
        statistics_s: float = 10.0,
        deadman: Deadman | None = None,
        clock: Clock | None = None,
    ) -> None:
        super().__init__(
            *(rig, gate, watchdog, sensors, link),
            rate_hz=rate_hz,
            statistics_s=statistics_s,
            deadman=deadman,
        )
        self._clock: Clock = time if clock is None else clock
        self._rate_hz = rate_hz
        self._samples = samples
        self._paced_by_rig = paced_by_rig
        self._lockstep = lockstep
        self._is_answered = lockstep is not None and lockstep.is_answered
        self._spared = 0
        self.late_s = Window(max(1, round(statistics_s * rate_hz)))

    @property
    def off_rate(self) -> str:
        """In real time, the measured rate when it is not the one that was asked for; else empty."""
        if self._lockstep is not None:
            return ""
        wanted_s = (self.sequence - 1) * self._period_s
        allowed_s = max(OFF_RATE * wanted_s, _OFF_S + 2.0 * self._period_s)
        for clock, passed_s in zip(_CLOCKS, self._passed_s(), strict=True):
            if wanted_s >= _REPORT_S and not abs(passed_s - wanted_s) <= allowed_s:
                rate_hz = self._rate_hz * wanted_s / passed_s
                return f"{rate_hz:.1f} Hz by {clock}, for rate_hz = {self._rate_hz:g}"
        return ""

    @property
    def waits_s(self) -> float:
        """Time for which the newest sample has waited for its answer, s; 0 where none waits."""
        if self._lockstep is None or not self._is_answered or self.taken == 0:
            return 0.0
        is_answered = self.commander.answered == self.sequence
        return 0.0 if is_answered else self._clock.monotonic() - self._tick_s

    def run(self, stop: threading.Event) -> None:
        """Sample until told to stop or until all samples are taken; the drive ends at zero.

        Raises
        ------
        RigError
            When the rig fails. The drive is stopped before this or any other error is raised.
        """
        try:
            self._rig.open()
            self.safety.on(Event.START)
            with self._deadman or nullcontext():
                if self._lockstep is not None:
                    self._run_in_lockstep(self._lockstep, stop)
                elif self._paced_by_rig:
                    self._run_by_the_rig(stop)
                else:
                    self._run_by_the_clock(stop)
        except BaseException as error:
            self._rig.safe_stop()
            self._hold(Event.FAILURE, str(error))
            raise
        finally:
            self._rig.safe_stop()
            self.safety.on(Event.END)
            self._rig.close()

    def _run_by_the_clock(self, stop: threading.Event) -> None:
        deadline_s = self._clock.monotonic()
        skipped = 0
        while not stop.is_set():
            self._take(self._read(), self._clock.monotonic(), skipped)
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
            self._take(sample, self._clock.monotonic(), max(0, round(periods) - 1))
            if self._is_last():
                return
            # The wait ends a little early, so that lateness does not persist; reading waits it out.
            self._serve_until(self._tick_s + self._period_s - _WAKE_MARGIN_S, stop)

    def _run_in_lockstep(self, lockstep: LockStep, stop: threading.Event) -> None:
        deadline_s = self._clock.monotonic()
        while not stop.is_set():
            self._take(self._read(), self._clock.monotonic())
            if self._is_last():
                return
            # No command can act on a drive that is held at zero: the arm moves on at its pace.
            waits = self._is_answered and self.safety.state is not DriveState.HELD
            if waits:
                self._await_answer(lockstep.answer_timeout_s, stop)
            # Without a pace, unanswered samples would run away from a commander that starts later.
            pace = lockstep.real_time_factor or (0.0 if waits else 1.0)
            if not pace:
                deadline_s = self._clock.monotonic()
                continue
            period_s = self._period_s / pace
            deadline_s += period_s
            late_s = self._serve_until(deadline_s, stop)
            if late_s > period_s:
                deadline_s += late_s

    def _is_last(self) -> bool:
        return bool(self._samples) and self.sequence >= self._samples

    def _serve(self, timeout_s: float) -> bool:
        """Let the next command act; return whether a command came in time."""
        command = self._link.wait(timeout_s)
        if command is None:
            return False
        # A late command may not act, but its sender is there: the next sample waits for it.
        if self._act(command, self._clock.monotonic()) in (Verdict.ACCEPTED, Verdict.LATE):
            self._is_answered = True
        self._watched(self._link.acted)
        return True

    def _serve_until(self, deadline_s: float, stop: threading.Event) -> float:
        """Let commands act until a deadline, and return the lateness at the end, s."""
        if self._spared < self.taken - 1:
            # The answer of a law in this process is there already.
            self._serve(0.0)
            self._spare()
        while not stop.is_set():
            left_s = deadline_s - self._clock.monotonic()
            if left_s <= _WAKE_MARGIN_S:
                self._clock.sleep(max(0.0, left_s))
                # An answer may have come in this sleep.
                if self.commander.answered != self.sequence:
                    self._serve(0.0)
                break
            has_come = self._serve(min(left_s - _WAKE_MARGIN_S, _STOP_POLL_S))
            left_s = deadline_s - self._clock.monotonic()
            is_done = not has_come or self.commander.answered == self.sequence
            if is_done and left_s > _SPARE_S:
                self._spare()
        late_s = self._clock.monotonic() - deadline_s
        self.late_s.add(late_s)
        return late_s

    def _spare(self) -> None:
        self._spared = self.taken
        self._watched(self._link.spare_time)

    def _await_answer(self, timeout_s: float, stop: threading.Event) -> None:
        until_s = self._clock.monotonic() + timeout_s
        while self.commander.answered != self.sequence and not stop.is_set():
            self._spare()
            left_s = until_s - self._clock.monotonic()
            has_come = self._serve(max(0.0, min(left_s, _STOP_POLL_S)))
            if self._emergency or self.commander.answered == self.sequence:
                return
            # Commands that answer no sample may go on for ever.
            if left_s <= (0.0 if has_come else _STOP_POLL_S):
                self._is_answered = False
                self._lose_commander()
                return
