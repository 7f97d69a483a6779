"""Rigs that do not sample at the rate that was asked for."""

from __future__ import annotations

import threading

import pytest

from flexarm_daq.loop.acquisition import Acquisition, LockStep
from flexarm_daq.loop.limiter import arm_gate
from flexarm_daq.loop.sensor_check import SensorCheck
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.rig_protocol import has_own_clock
from flexarm_daq.rigs.simulated import SimulatedRig
from support.acquisition_bench import (
    NO_NOISE,
    PERIOD_S,
    RATE_HZ,
    LoggingRig,
    ScriptedLink,
    acquisition_clock,
    never,
)

SAMPLES = 600


def off_rate(
    *, rate_hz: float = RATE_HZ, by_rig: bool = False, counts: bool = False, virtual: bool = False
) -> str:
    """Return what is told of a rig that reads at once; its times are counted at 256 Hz, or true."""
    with acquisition_clock() as clock:
        loop = Acquisition(
            LoggingRig(clock, virtual=counts),
            arm_gate(),
            Watchdog(1.0 / rate_hz),
            SensorCheck(rate_hz, NO_NOISE),
            ScriptedLink(clock, never),
            rate_hz=rate_hz,
            samples=SAMPLES,
            paced_by_rig=by_rig,
            lockstep=LockStep(2.0, 1.0, is_answered=False) if virtual else None,
        )
        loop.run(threading.Event())
        return loop.off_rate


@pytest.mark.parametrize("counts", [False, True])
def test_rig_that_reads_at_once___paced_by_the_node___is_in_time(*, counts: bool) -> None:
    assert off_rate(counts=counts) == ""


def test_rig_that_reads_at_once___though_it_has_a_clock___is_reported() -> None:
    # The loop leaves 0.2 ms of each period to the rig.
    rate_hz = 1.0 / (PERIOD_S - 2e-4)
    assert off_rate(by_rig=True) == f"{rate_hz:.1f} Hz by the machine's clock, for rate_hz = 256"


def test_rig_whose_times_are_of_another_rate___is_reported() -> None:
    reported = off_rate(rate_hz=512.0, counts=True)
    assert reported == "256.0 Hz by the rig's clock, for rate_hz = 512"


def test_virtual_time___at_another_pace___is_in_time() -> None:
    assert off_rate(counts=True, virtual=True) == ""


def test_board_alone___has_a_clock_of_its_own() -> None:
    assert has_own_clock(NidaqRig())
    assert not has_own_clock(SimulatedRig())
