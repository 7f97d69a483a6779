"""Invariants of the drive, checked at every sample, command and write, by other means than ours.

What the drive does is read at the rig, and who sent a command is known here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.safety import DriveState, Event
from flexarm_daq.rigs.faulty import Fault

if TYPE_CHECKING:
    from bench.schedules.messages import Answer
    from bench.schedules.schedule import Schedule
    from bench.schedules.world import World
    from flexarm_core.signals import Command
    from flexarm_daq.loop.acquisition import Acquisition
    from flexarm_daq.loop.exchange import Record
    from flexarm_daq.loop.limiter import LimiterSettings

_ROUNDING: Final = 1e-9
# The slowest fault decays to the end of the range before anybody can tell.
_DECAY_SAMPLES: Final = 25
_GAUGE_S: Final = 0.5
_SPEED_S: Final = 0.1
_STUCK_SAMPLES: Final = 30
_STOPS_SAMPLES: Final = 3


class Violation(BaseException):
    """An invariant does not hold. No `except Exception` of the graph may swallow it."""


class Oracle:
    """Judge of one run of the loop.

    Parameters
    ----------
    schedule : Schedule
        Setting of the run.
    world : World
        Its time.
    limits : LimiterSettings
        Limits in force; a change of them is told to `limits`.

    Attributes
    ----------
    drive_v : float
        Command in force at the rig, V.
    delayed_s : float
        Time by which the loop was stalled since the last sample, s.
    broken : tuple of Fault, str and int, or None
        Fault of the rig, its sensor, and the first sample that has it, counted from 1.
    """

    def __init__(self, schedule: Schedule, world: World, limits: LimiterSettings) -> None:
        self._schedule = schedule
        self._world = world
        self._period_s = 1.0 / schedule.rate_hz
        self.limits = limits
        self.drive_v = 0.0
        self.delayed_s = 0.0
        self.broken: tuple[Fault, str, int] | None = None
        self.stopped = False
        self.loop: Acquisition
        self._position_v = 0.0
        self._at_reading_v = 0.0
        self._samples: dict[int, float] = {}
        self._first: Record | None = None
        self._newest: Record | None = None
        self._taken_commands = 0
        self._pending: tuple[Answer, int] | None = None
        self._obeyed: Command | None = None
        self._reign: Answer | None = None
        self._has_rival = False
        self._senders: set[str] = set()
        self._numbers: dict[str, int] = {}
        self._miscounts = False
        self._once: tuple[str, int] | None = None

    def on_read(self) -> None:
        """Note the drive while a sample is taken."""
        self._at_reading_v = self.drive_v

    def on_sample(self, record: Record, volts: list[float]) -> None:
        """Check a sample that is published, and the drive after it."""
        self._settle()
        self._release_if_silent()
        self._check_numbers(record)
        self._newest = record
        self._first = self._first or record
        self._samples[record.sequence] = record.time_s
        self._position_v = volts[0]
        self.delayed_s = 0.0
        self._check_drive(record.sequence)
        if self.broken is not None:
            self._check_sensors(*self.broken)
        if self._reign is not None and self._is_old(self._reign.command):
            self._reign, self._has_rival = None, False

    def on_command(self, answer: Answer) -> None:
        """Take note of a command that the loop has in its hands."""
        self._settle()
        self._release_if_silent()
        self._taken_commands += 1
        self._pending = answer, self._accepted()

    def on_write(self, command_v: float) -> None:
        """Check a command of the drive before it acts."""
        limits, before_v = self.limits, self.drive_v
        self._require(math.isfinite(command_v), "the command is not a finite number")
        self._require(
            abs(command_v) <= limits.max_command_v + _ROUNDING,
            f"command of {command_v:g} V, the limit is {limits.max_command_v:g} V",
        )
        if command_v:
            change_v = abs(command_v - before_v)
            allowed_v = limits.max_slew_v_per_s * self._period_s
            # Limits that were lowered take a command back at once.
            is_cut = abs(before_v) > limits.max_command_v
            self._require(
                change_v <= allowed_v + _ROUNDING or is_cut,
                f"the command changes by {change_v:g} V, the limit is {allowed_v:g} V",
            )
            self._require(
                abs(self._position_v) <= limits.position_bound_v
                or command_v * self._position_v <= 0.0,
                f"command of {command_v:g} V outward beyond the bound at {self._position_v:g} V",
            )
            self._check_origin(command_v)
        self.drive_v = command_v

    def on_end(self, *, failed: bool) -> None:
        """Check the numbers of a run that has failed, or ended by its user."""
        self._settle()
        loop, safety = self.loop, self.loop.safety
        self._require(self.drive_v == 0.0, "the drive is not at zero after the end")
        self._require(safety.state is DriveState.OFF, "the drive is not off after the end")
        # A failure may come between a sample and its publication.
        unpublished = loop.taken - len(self._samples)
        self._require(0 <= unpublished <= failed, f"{unpublished} samples were not published")
        judged = loop.commander.verdicts.total()
        self._require(
            judged == self._taken_commands,
            f"{judged} of {self._taken_commands} commands counted",
        )

    def _check_numbers(self, record: Record) -> None:
        before, first, period_s = self._newest, self._first, self._period_s
        self._require(
            record.commands[0] == self._at_reading_v,
            f"sample {record.sequence} says {record.commands[0]:g} V, the drive had "
            f"{self._at_reading_v:g} V",
        )
        if before is None or first is None:
            self._require(record.sequence == 1, f"the first sample has number {record.sequence}")
            return
        self._require(record.sequence > before.sequence, "the numbers of the samples go back")
        late_s = record.time_s - first.time_s - (record.sequence - 1) * period_s
        lockstep = self._schedule.time == "virtual"
        self._require(
            -_ROUNDING <= late_s < (_ROUNDING if lockstep else period_s + _ROUNDING),
            f"sample {record.sequence} is {1e3 * late_s:.3f} ms off its period",
        )
        self._require(
            self.loop.missed == record.sequence - self.loop.taken,
            f"{self.loop.missed} missed periods counted",
        )
        waited_s = record.taken_s - before.taken_s - self.delayed_s
        longest_s = period_s + (self._schedule.answer_timeout_s if lockstep else 0.0)
        self._require(
            waited_s <= longest_s + period_s / 10.0,
            f"no sample for {1e3 * waited_s:.1f} ms",
        )

    def _check_drive(self, sequence: int) -> None:
        """Check that the drive is at zero where it has to be."""
        if not self.drive_v:
            return
        self._require(not self.stopped, "the drive is not at zero after an emergency stop")
        self._require(self.loop.safety.driving, f"the drive is {self.loop.safety.state.value}")
        self._require(
            self._obeyed is not None and not self._is_old(self._obeyed),
            f"at sample {sequence} the drive has the answer to sample "
            f"{self._obeyed.state_sequence if self._obeyed else 0}",
        )

    def _check_origin(self, command_v: float) -> None:
        """Check that a command of the drive is one that came, in time, for a sample."""
        self._require(self._pending is not None, "the drive moves without a command")
        assert self._pending is not None  # noqa: S101 - checked
        command = self._pending[0].command
        self._require(not self.stopped, "the drive moves after an emergency stop")
        self._require(
            command.state_sequence in self._samples and not self._is_old(command),
            f"the drive has the answer to sample {command.state_sequence} "
            f"at sample {self._newest.sequence if self._newest else 0}",
        )
        self._require(
            self._obeyed is None or command.state_sequence > self._obeyed.state_sequence,
            f"the drive has a second answer to sample {command.state_sequence}",
        )
        wanted_v, most_v = command.efforts[0] + command.compensations[0], self.limits.max_command_v
        ends_v = [min(max(each, -most_v), most_v) for each in (self.drive_v, wanted_v)]
        self._require(
            min(ends_v) - _ROUNDING <= command_v <= max(ends_v) + _ROUNDING,
            f"the drive has {command_v:g} V, the command wants {wanted_v:g} V",
        )
        self._obeyed = command

    def _check_sensors(self, fault: Fault, channel: str, first: int) -> None:
        """Check that a broken sensor is found in the time that `docs/safety.md` states."""
        longest = _samples_to_find(fault, channel, self._schedule.rate_hz)
        if longest is None or len(self._samples) - first < longest:
            return
        self._require(
            self.loop.safety.state is DriveState.HELD,
            f"{channel} is {fault.value} for {longest} samples and the drive is not held",
        )

    def _settle(self) -> None:
        """Judge who was obeyed, once the loop has dealt with a command."""
        if self._pending is None:
            return
        (answer, accepted_before), self._pending = self._pending, None
        accepted = self._accepted() > accepted_before
        reign = self._reign
        self._senders.add(answer.sender)
        self._check_number(answer, accepted=accepted)
        if reign is not None and self.loop.safety.driving:
            self._check_commanders(reign, answer, accepted=accepted)
        conflicts = self.loop.safety.counts[Event.TWO_COMMANDERS]
        is_one = len(self._senders) == 1 and not self._miscounts
        self._require(not conflicts or not is_one, "two commanders, but there is one")
        if accepted:
            self._reign = answer

    def _check_number(self, answer: Answer, *, accepted: bool) -> None:
        """Check that a sender that repeats a number is obeyed once."""
        sender, number = answer.sender, answer.command.sequence
        self._miscounts |= self._numbers.get(sender) == number
        self._numbers[sender] = number
        repeats = self._once == (sender, number)
        self._require(not (accepted and repeats), f"{sender} is obeyed again with number {number}")
        if accepted:
            self._once = sender, number
        elif not repeats:
            self._once = None

    def _check_commanders(self, reign: Answer, answer: Answer, *, accepted: bool) -> None:
        command = answer.command
        is_other = reign.sender != answer.sender and not _continues(reign.command, command)
        if accepted:
            self._require(not is_other, f"two commanders drive: {reign.sender}, {answer.sender}")
            self._require(not self._has_rival, "the commander in force goes on beside another one")
        elif is_other and not self._is_old(command) and command.state_sequence in self._samples:
            self._require(
                command.state_sequence != reign.command.state_sequence,
                f"two answers to sample {command.state_sequence} and the drive is not held",
            )
            self._has_rival = True

    def _release_if_silent(self) -> None:
        """Note that in virtual time a commander that does not answer in time gives up its place."""
        reign, newest = self._reign, self._newest
        if (
            self._schedule.time == "virtual"
            and reign is not None
            and newest is not None
            and reign.command.state_sequence != newest.sequence
            and self._world.now_s - newest.taken_s >= self._schedule.answer_timeout_s - _ROUNDING
        ):
            self._reign, self._has_rival = None, False

    def _is_old(self, command: Command) -> bool:
        assert self._newest is not None  # noqa: S101 - commands answer samples
        longest = self._schedule.max_age_periods
        taken_s = self._samples.get(command.state_sequence, -math.inf)
        return (
            self._newest.sequence - command.state_sequence >= longest
            or self._newest.time_s - taken_s >= longest * self._period_s - _ROUNDING
        )

    def _accepted(self) -> int:
        return self.loop.commander.verdicts[Verdict.ACCEPTED]

    def _require(self, holds: bool, what: str) -> None:  # noqa: FBT001 - a condition
        if not holds:
            raise Violation(what)


def _continues(last: Command, command: Command) -> bool:
    """Return whether one sender could have sent both: nothing else tells senders apart."""
    commands = command.sequence - last.sequence
    samples = command.state_sequence - last.state_sequence
    return 1 <= commands <= samples or 1 <= -commands <= -samples


def _samples_to_find(fault: Fault, channel: str, rate_hz: float) -> int | None:
    """Return after how many samples the drive must be held; None for what may stay unnoticed."""
    if fault is Fault.NOT_A_NUMBER:
        return 0
    if fault is Fault.STUCK:
        return _STUCK_SAMPLES
    if fault not in (Fault.OPEN, Fault.SATURATED):
        return None
    if channel == "position_v":
        return _STOPS_SAMPLES + _DECAY_SAMPLES
    seconds = _SPEED_S if channel == "speed_v" else _GAUGE_S
    return math.ceil(seconds * rate_hz) + _DECAY_SAMPLES
