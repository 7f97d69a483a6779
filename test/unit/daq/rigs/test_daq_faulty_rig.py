from __future__ import annotations

import math

import numpy as np
import pytest

from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.errors import SettingError
from flexarm_daq.rigs.faulty import SENSOR_FAULTS, Fault, FaultyRig
from flexarm_daq.rigs.rig_protocol import RigError, RigSample
from flexarm_daq.rigs.simulated import SimulatedRig

GOOD = 5


def samples(
    fault: Fault | None, channel: str = "position_v", count: int = 60, good: int = GOOD
) -> list[RigSample]:
    """Read a rig that is driven, through a fault or without."""
    healthy = SimulatedRig(seed=2)
    rig = (
        healthy if fault is None else FaultyRig(healthy, fault, after_samples=good, channel=channel)
    )
    rig.open()
    found = []
    for _ in range(count):
        found.append(rig.read())
        rig.write([3.0])
    return found


def of(found: list[RigSample], channel: str) -> list[float]:
    return [float(sample.outputs[CHANNEL_NAMES.index(channel)]) for sample in found]


@pytest.mark.parametrize("fault", SENSOR_FAULTS)
@pytest.mark.parametrize("channel", CHANNEL_NAMES)
def test_sensor_fault___spoils_its_channel_from_its_sample_on_and_no_other(
    fault: Fault, channel: str
) -> None:
    healthy, faulty = samples(None), samples(fault, channel)
    assert [sample.time_s for sample in faulty] == [sample.time_s for sample in healthy]
    for name in CHANNEL_NAMES:
        good = len(healthy) if name != channel else GOOD
        assert of(faulty, name)[:good] == of(healthy, name)[:good]
    assert of(faulty, channel)[GOOD : GOOD + 30] != of(healthy, channel)[GOOD : GOOD + 30]


def test_stuck___repeats_the_last_good_reading() -> None:
    readings = of(samples(Fault.STUCK, "speed_v"), "speed_v")
    assert set(readings[GOOD:]) == {readings[GOOD - 1]}


def test_stuck_from_the_start___reads_zero() -> None:
    assert set(of(samples(Fault.STUCK, "speed_v", good=0), "speed_v")) == {0.0}


def test_open___floats_to_the_end_of_the_range() -> None:
    readings = of(samples(Fault.OPEN, "base_strain_v"), "base_strain_v")
    assert np.all(np.diff(readings[GOOD:]) > 0.0)
    assert readings[GOOD] < 6.0
    assert 9.999 < readings[GOOD + 40] <= 10.0


def test_saturated___and_not_a_number___are_so_at_once() -> None:
    assert set(of(samples(Fault.SATURATED), "position_v")[GOOD:]) == {-10.0}
    assert all(math.isnan(v) for v in of(samples(Fault.NOT_A_NUMBER), "position_v")[GOOD:])


def test_noise_burst___is_over_after_thirty_samples() -> None:
    healthy, faulty = (
        of(samples(None), "speed_v"),
        of(samples(Fault.NOISE_BURST, "speed_v"), "speed_v"),
    )
    burst = np.subtract(faulty, healthy)[GOOD : GOOD + 30]
    assert 0.5 < burst.std() < 1.5
    assert faulty[GOOD + 30 :] == healthy[GOOD + 30 :]


def test_short_read___and_frozen_time___of_the_converter() -> None:
    lengths = [len(sample.outputs) for sample in samples(Fault.SHORT_READ)]
    assert lengths == [4] * GOOD + [3] * (60 - GOOD)
    times_s = [sample.time_s for sample in samples(Fault.FROZEN_TIME)]
    assert set(times_s[GOOD:]) == {times_s[GOOD - 1]}


@pytest.mark.parametrize(
    ("fault", "error"), [(Fault.READ_ERROR, RigError), (Fault.EXCEPTION, ArithmeticError)]
)
def test_reading___raises_from_its_sample_on(fault: Fault, error: type[Exception]) -> None:
    assert len(samples(fault, count=GOOD)) == GOOD
    with pytest.raises(error, match="injected"):
        samples(fault, count=GOOD + 1)


def test_write_error___lets_safe_stop_through_and_heals_at_the_next_opening() -> None:
    inner = SimulatedRig()
    rig = FaultyRig(inner, Fault.WRITE_ERROR, after_samples=1)
    for _ in range(2):
        rig.open()
        rig.read()
        rig.write([3.0])
        rig.read()
        with pytest.raises(RigError, match="injected"):
            rig.write([3.0])
        rig.safe_stop()
        assert inner._command_v == 0.0
        rig.close()


@pytest.mark.parametrize(
    ("channel", "after", "complaint"),
    [("tip_v", 0, "channel must be one of position_v"), ("speed_v", -1, "must not be negative")],
)
def test_rig___with_an_impossible_fault___is_refused(
    channel: str, after: int, complaint: str
) -> None:
    with pytest.raises(SettingError, match=complaint):
        FaultyRig(SimulatedRig(), Fault.OPEN, after_samples=after, channel=channel)
