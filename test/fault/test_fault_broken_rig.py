from __future__ import annotations

import pytest

from flexarm_daq.loop.sensor_check import SensorLimits
from flexarm_daq.rigs.faulty import Fault
from support.fault_injection import CASES, RATE_HZ, inject

LIMITS = SensorLimits()
# A floating input takes some samples to the end of its range.
FLOATS = 30


def allowed_periods(fault: Fault, channel: str) -> int:
    """Return how long the drive may go on, by what stands in docs/safety.md."""
    if fault is Fault.STUCK:
        return LIMITS.stuck_samples - 1
    if fault not in {Fault.OPEN, Fault.SATURATED}:
        return 0
    longest_s = {"position_v": LIMITS.travel_samples / RATE_HZ, "speed_v": LIMITS.speed_saturated_s}
    floats = FLOATS if fault is Fault.OPEN else 0
    return floats + round(longest_s.get(channel, LIMITS.gauge_saturated_s) * RATE_HZ)


@pytest.mark.parametrize(
    ("fault", "channel"), [case for case in CASES if case[0] is not Fault.NOISE_BURST]
)
def test_broken_rig___takes_the_drive_to_zero_in_time(fault: Fault, channel: str) -> None:
    for seed in range(5):
        injection = inject(fault, channel, seed)
        assert injection.ended_at_zero
        assert injection.largest_v <= 10.0
        assert injection.periods is not None, injection
        assert injection.periods <= allowed_periods(fault, channel), injection


@pytest.mark.parametrize("channel", [case[1] for case in CASES if case[0] is Fault.NOISE_BURST])
def test_noise_burst___leaves_every_command_within_its_limits(channel: str) -> None:
    for seed in range(5):
        injection = inject(Fault.NOISE_BURST, channel, seed)
        assert injection.ended_at_zero
        assert injection.largest_v <= 10.0
