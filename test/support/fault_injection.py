"""Injection of faults into the sampling loop, in virtual time and in one process.

The arm is the simulated one, the controller a PD law whose set-point never lets it rest, so that
the drive is at zero only when somebody sets it there.
"""

from __future__ import annotations

import math
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.signals import Command
from flexarm_daq.loop.acquisition import Acquisition, LockStep
from flexarm_daq.loop.limiter import arm_gate
from flexarm_daq.loop.sensor_check import SensorCheck
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.rigs.faulty import SENSOR_FAULTS, Fault, FaultyRig
from flexarm_daq.rigs.rig_protocol import RigError
from flexarm_daq.rigs.simulated import SimulatedRig
from support.acquisition_bench import Clock

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_daq.loop.exchange import Record
    from flexarm_daq.rigs.rig_protocol import Rig, RigSample

RATE_HZ = 300.0
SAMPLES_AFTER = 300

CASES = [
    (fault, channel)
    for fault in Fault
    for channel in (CHANNEL_NAMES if fault in SENSOR_FAULTS else CHANNEL_NAMES[:1])
]
"""Every fault, and every sensor for those that concern one."""


@dataclass(frozen=True)
class Injection:
    """Outcome of one fault.

    `periods` counts from the first sample with the fault to the one at which the drive went to
    zero for good; None if it did not.
    """

    fault: Fault
    channel: str
    after_samples: int
    periods: int | None
    reason: str
    largest_v: float
    ended_at_zero: bool


class Witness:
    """Drive that notes its commands."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self.drive_v: list[float] = []
        """Drive after each sample and its answer."""
        self.now_v = math.nan

    def open(self) -> None:
        self._rig.open()
        self.now_v = 0.0

    def read(self) -> RigSample:
        if math.isfinite(self.now_v):
            self.drive_v.append(self.now_v)
        return self._rig.read()

    def write(self, commands: Sequence[float]) -> None:
        (command_v,) = commands
        self._rig.write(commands)
        self.now_v = command_v

    def safe_stop(self) -> None:
        self._rig.safe_stop()
        self.now_v = 0.0

    def close(self) -> None:
        self._rig.close()


class RestlessController:
    """Controller of every sample: PD with friction compensation and a hasty square."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._answer: Command | None = None

    def publish(self, record: Record) -> None:
        reference_v = math.copysign(3.0, math.sin(2.0 * math.pi * 1.3 * record.time_s + 0.1))
        effort_v = reference_v - record.outputs[0] - 2.8 * record.outputs[3]
        compensation_v = math.copysign(0.7, effort_v)
        self._answer = Command(
            record.sequence, record.sequence, (float(effort_v),), (compensation_v,)
        )

    def wait(self, timeout_s: float) -> Command | None:
        answer, self._answer = self._answer, None
        if answer is None:
            # As on a machine, a wait takes a little longer than it was asked to.
            self._clock.sleep(timeout_s + 1e-6)
        return answer

    def commanders(self) -> list[str]:
        """Return nothing: nobody is asked for."""
        return []

    def acted(self) -> None:
        """Do nothing: nothing waits."""

    def spare_time(self) -> None:
        """Do nothing."""


def inject(fault: Fault, channel: str, seed: int) -> Injection:
    """Let one fault set in at a random moment of a run."""
    after = int(np.random.default_rng(seed).integers(30, 400))
    witness = Witness(SimulatedRig(rate_hz=RATE_HZ, seed=seed))
    clock = Clock()
    acquisition = Acquisition(
        FaultyRig(witness, fault, after_samples=after, channel=channel),
        arm_gate(),
        Watchdog(1.0 / RATE_HZ),
        SensorCheck(RATE_HZ),
        RestlessController(clock),
        rate_hz=RATE_HZ,
        samples=after + SAMPLES_AFTER,
        lockstep=LockStep(0.0, 0.001, is_answered=True),
        clock=clock,
    )
    with suppress(RigError, ArithmeticError):
        acquisition.run(threading.Event())
    drive_v = np.array(witness.drive_v)
    assert np.count_nonzero(drive_v[2:after]) == after - 2, "the drive rests without a fault"
    driven = np.flatnonzero(drive_v)[-1]
    # The drive noted at a sample is that of the time before it.
    has_stopped = acquisition.safety.reason != ""
    return Injection(
        fault,
        channel,
        after,
        max(0, int(driven) - after) if has_stopped else None,
        acquisition.safety.reason,
        float(np.abs(drive_v).max()),
        witness.now_v == 0.0,
    )
