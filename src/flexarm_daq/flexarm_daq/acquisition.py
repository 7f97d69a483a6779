"""The sampling loop: read the rig, hand the sample out, let the answer act, keep the drive safe.

A command acts when it arrives, inside the period: a whole sample of delay makes the thesis's
control loops unstable. In real time the loop ticks on absolute deadlines and serves commands in
between; when it is late it skips whole periods and counts them, it never bursts. In virtual time
it is lock-step: every sample waits for its answer, so a run is as fast as the machine allows and
gives the same numbers for the same seed.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flexarm_node.statistics import Window

if TYPE_CHECKING:
    import threading

    import numpy as np
    from numpy.typing import NDArray

    from flexarm_daq.limiter import Limiter
    from flexarm_daq.rig import Rig
    from flexarm_daq.watchdog import Watchdog

_STATISTICS_S = 10.0
# The middleware's timed wait wakes up late; the rest of the period is slept.
_WAKE_MARGIN_S = 2e-4


class Command(NamedTuple):
    """What a controller asks for in answer to one sample."""

    sequence: int
    state_sequence: int
    effort_v: float
    compensation_v: float


class Applied(NamedTuple):
    """What the drive was told: volts after the limiter, and which command they come from."""

    command_v: float
    compensation_v: float
    command_sequence: int


class Record(NamedTuple):
    """One sample with the command in force while it was taken."""

    sequence: int
    time_s: float
    volts: NDArray[np.float64]
    command_v: float
    compensation_v: float
    command_sequence: int


_NOTHING = Applied(0.0, 0.0, 0)


class Link(Protocol):
    """Where samples go and commands come from."""

    def publish(self, record: Record) -> None:
        """Hand one sample out."""

    def wait(self, timeout_s: float) -> Command | None:
        """Return the newest command, or None when none came in time."""


class Acquisition:
    """One run of the sampling loop.

    Parameters
    ----------
    rig, limiter, watchdog, link
        What is sampled, the last gate before it, the judge of the command's age, and the far end.
    rate_hz
        Sampling rate.
    samples
        The run ends by itself after that many samples; 0 runs until it is stopped.
    answer_timeout_s
        None runs in real time. Otherwise lock-step: how long a sample waits for its answer.
    """

    def __init__(
        self,
        rig: Rig,
        limiter: Limiter,
        watchdog: Watchdog,
        link: Link,
        *,
        rate_hz: float,
        samples: int = 0,
        answer_timeout_s: float | None = None,
    ) -> None:
        self._rig = rig
        self._limiter = limiter
        self._watchdog = watchdog
        self._link = link
        self._period_s = 1.0 / rate_hz
        self._samples = samples
        self._answer_timeout_s = answer_timeout_s
        self._emergency = False
        self._position_v = 0.0
        self._answer = Command(0, 0, 0.0, 0.0)
        self._applied = _NOTHING
        self._tick_s = 0.0
        self._sample_time_s = 0.0
        self.sequence = 0
        self.missed = 0
        self.unanswered = 0
        self.refused = 0
        self.limited = 0
        size = max(1, round(_STATISTICS_S * rate_hz))
        self.late_s = Window(size)
        self.reply_s = Window(size)

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
            When the rig fails; the drive has been told to stop before it is raised.
        """
        try:
            self._rig.open()
            deadline_s = time.monotonic()
            while not stop.is_set():
                self._tick()
                if self._samples and self.sequence >= self._samples:
                    break
                if self._answer_timeout_s is None:
                    deadline_s = self._next_deadline(deadline_s)
                    self._serve_until(deadline_s)
                    self.late_s.add(time.monotonic() - deadline_s)
                else:
                    self._await_answer(self._answer_timeout_s)
        finally:
            self._rig.safe_stop()
            self._rig.close()

    def _tick(self) -> None:
        sample = self._rig.read()
        self._tick_s = time.monotonic()
        if self._answer.state_sequence != self.sequence:
            self.unanswered += 1
        in_force = self._applied
        if in_force != _NOTHING and (self._emergency or self._watchdog.stale(sample.time_s)):
            self._write(_NOTHING)
            self._limiter.reset()
        self.sequence += 1
        self._position_v = float(sample.volts[0])
        self._link.publish(Record(self.sequence, sample.time_s, sample.volts, *in_force))
        self._sample_time_s = sample.time_s

    def _next_deadline(self, deadline_s: float) -> float:
        late_s = time.monotonic() - (deadline_s + self._period_s)
        skipped = max(0, int(late_s / self._period_s))
        self.missed += skipped
        return deadline_s + (1 + skipped) * self._period_s

    def _serve_until(self, deadline_s: float) -> None:
        while True:
            left_s = deadline_s - time.monotonic()
            if left_s <= _WAKE_MARGIN_S:
                time.sleep(max(0.0, left_s))
                return
            command = self._link.wait(left_s - _WAKE_MARGIN_S)
            if command is not None:
                self._act(command)

    def _await_answer(self, timeout_s: float) -> None:
        until_s = time.monotonic() + timeout_s
        while self._answer.state_sequence != self.sequence:
            command = self._link.wait(until_s - time.monotonic())
            if command is None:
                return
            self._act(command)

    def _act(self, command: Command) -> None:
        if not self._answer.state_sequence < command.state_sequence <= self.sequence:
            self.refused += 1
            return
        self._answer = command
        self._watchdog.fed(self._sample_time_s)
        self.reply_s.add(time.monotonic() - self._tick_s)
        if self._emergency:
            return
        limited = self._limiter.apply(
            command.effort_v, command.compensation_v, self._position_v, self._period_s
        )
        self.limited += bool(limited.reasons)
        self._write(Applied(limited.command_v, limited.compensation_v, command.sequence))

    def _write(self, applied: Applied) -> None:
        self._rig.write(applied.command_v)
        self._applied = applied
