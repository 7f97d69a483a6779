"""Process of the sampling loop: the real loop on a simulated rig, between links."""

from __future__ import annotations

import struct
import threading
from typing import TYPE_CHECKING

from bench.schedules.messages import STATE, Raw, State, state_bytes
from bench.schedules.oracle import Oracle
from bench.schedules.processes import Killed, Process
from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_daq.loop.acquisition import Acquisition, LockStep
from flexarm_daq.loop.limiter import arm_gate
from flexarm_daq.loop.sensor_check import SensorCheck
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.rigs.faulty import Fault, FaultyRig
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_daq.rigs.rig_protocol import RigError, RigSample
from flexarm_daq.rigs.simulated import SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.schedules.messages import Answer
    from bench.schedules.schedule import Event, Schedule
    from bench.schedules.world import Link, World
    from flexarm_core.signals import Command
    from flexarm_daq.loop.exchange import Record
    from flexarm_daq.loop.limiter import LimiterSettings

_DRIVE = struct.Struct("<2d")
# A wait is over a little late, so that it never ends just before its end by rounding.
_WAKE_UP_S = 1e-9


class Daq(Process):
    """Node of the rig.

    It is the one process that waits in the middle of its work, as the real loop does; the others
    get their turn while it waits.

    Parameters
    ----------
    world : World
        Its time, which it moves.
    schedule : Schedule
        Setting of the runs.
    readers : sequence of Link
        Ways of the samples to the commanders.
    to_recorder : Link
        Way of the samples to the recorder.
    note : callable
        Called with the bytes of everything that the loop sends and does.

    Attributes
    ----------
    wanted : bool
        Whether the node is to be active.
    """

    def __init__(
        self,
        world: World,
        schedule: Schedule,
        readers: Sequence[Link],
        to_recorder: Link,
        note: Callable[[bytes], None],
    ) -> None:
        super().__init__(world)
        self.wanted = True
        self.samples = 0
        self.runs: list[Acquisition] = []
        self.limits: LimiterSettings = schedule.limits
        self._schedule = schedule
        self._readers = readers
        self._to_recorder = to_recorder
        self._note = note
        self._broken: list[Event] = []
        self._inbox: list[Answer] = []
        self._stop = threading.Event()
        self._start_ns = 0
        self.loop: Acquisition | None = None
        self._oracle: Oracle
        # It is at rest after each opening, and making it takes longer than a second of samples.
        self._simulated = SimulatedRig(
            RigParameters(loop_delay_s=5e-4 if schedule.time == "virtual" else 0.0),
            rate_hz=schedule.rate_hz,
            seed=schedule.seed,
            clock=None if schedule.time == "virtual" else self.monotonic,
        )

    def run(self) -> None:
        """Be active until deactivated or killed, or until the rig fails."""
        world, schedule = self.world, self._schedule
        self.alive = True
        self._stop.clear()
        self._inbox.clear()
        self._oracle = Oracle(schedule, world, self.limits)
        self.loop = self._oracle.loop = Acquisition(
            self._rig(),
            arm_gate(self.limits),
            Watchdog(1.0 / schedule.rate_hz, schedule.max_age_periods),
            SensorCheck(schedule.rate_hz),
            self,
            rate_hz=schedule.rate_hz,
            paced_by_rig=schedule.time == "paced",
            lockstep=LockStep(1.0, schedule.answer_timeout_s, is_answered=True)
            if schedule.time == "virtual"
            else None,
            clock=self,
        )
        self.runs.append(self.loop)
        try:
            self.loop.run(self._stop)
        except Killed:
            return
        except (RigError, ArithmeticError) as error:
            if not str(error).startswith(("injected", "short reading", "the rig's clock")):
                raise
            self._oracle.on_end(failed=True)
        else:
            self._oracle.on_end(failed=False)
        finally:
            self.loop = None

    def break_rig(self, fault: Event) -> None:
        """Break the rig at an instant of an event, if it is sampled then."""
        self._broken.append(fault)

    def change_limits(self, limits: LimiterSettings) -> None:
        """Change the limits, at once."""
        self.limits = limits
        if self.loop is not None:
            self.loop.limit([limits.limits()])
            self._oracle.limits = limits

    def emergency_stop(self) -> None:
        """Call the service of this name."""
        if self.loop is not None:
            self.loop.emergency_stop()
            self._oracle.stopped = True

    def deactivate(self) -> None:
        """End the run, if there is one."""
        if self.loop is not None:
            self.wanted = False
            self._stop.set()

    def kill(self) -> None:
        """Kill the process in the middle of a run, if there is one."""
        if self.loop is not None:
            self.wanted = self.alive = False
            raise Killed

    def receive(self, answer: Answer) -> None:
        """Take a command: the newest one waits."""
        if self.loop is not None:
            self._inbox[:] = [answer]

    # What the loop asks of its clock.

    def monotonic(self) -> float:
        """Return the steady time, s."""
        return self.world.now_s

    def sleep(self, seconds: float) -> None:
        """Let time pass, and more when the process is stalled."""
        self.world.sleep(seconds)
        self._stand_still()

    # What the loop asks of its far end.

    def publish(self, record: Record) -> None:
        """Send one sample."""
        volts = record.outputs.tolist()
        self._oracle.on_sample(record, volts)
        self.samples += 1
        if record.sequence == 1:
            self._start_ns = record.start_ns(self.world.wall_ns(), self.world.now_s)
        stamp_ns = self._start_ns + round(record.time_s * 1e9)
        drive = DriveCommand(*record.commands, *record.compensations)
        state = State(record.sequence, stamp_ns, volts, drive)
        for link in self._readers:
            link.send(state)
        raw = state_bytes(record, volts, stamp_ns)
        self._note(raw)
        self._to_recorder.send(Raw(STATE, raw, self.world.wall_ns(), self.world.now_s))

    def wait(self, timeout_s: float) -> Command | None:
        """Return the newest command, or None when none came in time."""
        if not self._inbox:
            self.world.advance(self.world.now_s + max(timeout_s, 0.0) + _WAKE_UP_S, self._inbox)
            self._stand_still()
        if not self._inbox:
            return None
        answer = self._inbox.pop()
        self._oracle.on_command(answer)
        return answer.command

    def commanders(self) -> list[str]:
        """Return nothing: nobody is asked for."""
        return []

    def acted(self) -> None:
        """Do nothing: nothing waits."""

    def spare_time(self) -> None:
        """Report nothing."""

    def note_drive(self, command_v: float) -> None:
        """Note a command of the drive."""
        self._note(_DRIVE.pack(self.world.now_s, command_v))

    def _stand_still(self) -> None:
        while self.stalled:
            before_s = self.world.now_s
            self.world.advance(self.stalled_until_s)
            self._oracle.delayed_s += self.world.now_s - before_s

    def _rig(self) -> FaultyRig | _Witness:
        """Return the rig, with the next fault that is due."""
        schedule = self._schedule
        rig = _Witness(
            self._simulated,
            self,
            self._oracle,
            1.0 / schedule.rate_hz if schedule.time == "paced" else 0.0,
        )
        due = [fault for fault in self._broken if fault.at_s > self.world.now_s]
        if not due:
            return rig
        fault_name, channel = due[0].target.split()
        after = round((due[0].at_s - self.world.now_s) * schedule.rate_hz)
        fault = Fault(fault_name)
        self._oracle.broken = fault, channel, after + 1
        return FaultyRig(rig, fault, after_samples=after, channel=channel)


class _Witness:
    """Drive that shows every command to the oracle; a dead process moves it no more.

    Parameters
    ----------
    rig : SimulatedRig
        The rig.
    owner : Daq
        Process that drives it.
    oracle : Oracle
        Judge of its commands.
    period_s : float
        Period of the rig's own clock, by which reading waits, s; 0: reading waits for nothing.
    """

    def __init__(self, rig: SimulatedRig, owner: Daq, oracle: Oracle, period_s: float) -> None:
        self._rig = rig
        self._owner = owner
        self._oracle = oracle
        self._period_s = period_s
        self._opened_s = 0.0
        self._tick = -1

    def open(self) -> None:
        self._rig.open()
        self._opened_s = self._owner.world.now_s

    def read(self) -> RigSample:
        if self._period_s:
            self._await_tick(self._period_s)
        self._oracle.on_read()
        sample = self._rig.read()
        return RigSample(self._tick * self._period_s, sample.outputs) if self._period_s else sample

    def _await_tick(self, period_s: float) -> None:
        """Wait for the next sample of the board; after a stall, the newest one is there."""
        passed_s = self._owner.world.now_s - self._opened_s
        self._tick = max(self._tick + 1, int(passed_s / period_s))
        self._owner.sleep(max(0.0, self._tick * period_s - passed_s))
        passed_s = self._owner.world.now_s - self._opened_s
        self._tick = max(self._tick, int(passed_s / period_s))

    def write(self, commands: Sequence[float]) -> None:
        (command_v,) = commands
        self._oracle.on_write(command_v)
        self._owner.note_drive(command_v)
        self._rig.write(commands)

    def safe_stop(self) -> None:
        if self._owner.alive:
            self._rig.safe_stop()
            self._oracle.drive_v = 0.0

    def close(self) -> None:
        if self._owner.alive:
            self._rig.close()
