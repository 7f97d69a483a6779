from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.channels import CHANNEL_NAMES, INPUT_RANGE_V
from flexarm_core.errors import SettingError
from flexarm_daq.loop.sensor_check import SensorCheck, SensorLimits
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, THESIS_NOISE_V, RigParameters
from flexarm_daq.rigs.simulated import SimulatedRig
from support.driven_rig import driven
from support.exhaustive import first_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from support.driven_rig import Drive

NO_NOISE_V = (0.0, 0.0, 0.0, 0.0)
RATE_HZ = 300.0


def square(height_v: float, frequency_hz: float) -> Drive:
    return lambda time_s, _: math.copysign(
        height_v, math.sin(2.0 * math.pi * frequency_hz * time_s)
    )


def hold(time_s: float, volts: NDArray[np.float64]) -> float:
    """Control the arm to and fro."""
    reference_v = math.copysign(3.0, math.sin(2.5 * time_s))
    return float(reference_v - volts[0] - 2.8 * volts[3])


DRIVES: dict[str, Drive] = {
    "rest": lambda *_: 0.0,
    "control": hold,
    "identification": square(2.5, 0.5),
    "bang-bang against both stops": square(10.0, 0.7),
    "leaning on a stop": lambda *_: 10.0,
    "second resonance": square(10.0, 9.0),
    "fast": square(6.0, 30.0),
}


def complaints(
    parameters: RigParameters, drive: Drive, *, seed: int, rate_hz: float, length_s: float
) -> list[str]:
    """Drive a healthy rig and return what the check says."""
    rig = SimulatedRig(parameters, rate_hz=rate_hz, seed=seed)
    has_noise = parameters.noise_v != NO_NOISE_V
    check = SensorCheck(rate_hz, None if has_noise else SensorLimits(stuck_samples=0))
    run = driven(rig, drive, int(length_s * rate_hz), rate_hz)
    found = [check.complaint(*sample) for sample in zip(run.time_s.tolist(), run.y, strict=True)]
    return [each for each in found if each]


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("noise_v", first_of([(LOW_NOISE_V,), (THESIS_NOISE_V,), (NO_NOISE_V,)]))
@pytest.mark.parametrize("payload_kg", first_of([0.4, 0.0]))
def test_healthy_rig___in_any_motion___gives_no_alarm(
    drive: str, noise_v: tuple[float, float, float, float], payload_kg: float
) -> None:
    parameters = RigParameters(payload_kg=payload_kg, noise_v=noise_v)
    for seed in range(3):
        found = complaints(parameters, DRIVES[drive], seed=seed, rate_hz=RATE_HZ, length_s=3.0)
        assert found == []


@pytest.mark.parametrize("rate_hz", [10.0, 99.0, 100.0, 500.0, 1000.0])
def test_healthy_rig___at_any_rate___gives_no_alarm(rate_hz: float) -> None:
    for drive in ("control", "bang-bang against both stops"):
        assert complaints(RigParameters(), DRIVES[drive], seed=1, rate_hz=rate_hz, length_s=2) == []


@pytest.mark.slow
def test_healthy_rig___at_rest_for_long___gives_no_alarm() -> None:
    """Noise of one converter step: the codes repeat, but not thirty times."""
    random = np.random.default_rng(3)
    step_v = 20.0 / 4096
    volts = np.rint(random.standard_normal((200_000, 4)) * LOW_NOISE_V / step_v) * step_v
    check = SensorCheck(RATE_HZ, SensorLimits(disagreement_rad=1e6))
    assert not any(check.complaint(k / RATE_HZ, row) for k, row in enumerate(volts))


def first_complaint(
    volts: NDArray[np.float64], limits: SensorLimits | None = None
) -> tuple[int, str]:
    """Return sample and text of the first complaint."""
    check = SensorCheck(RATE_HZ, limits)
    for k, row in enumerate(volts):
        if text := check.complaint(k / RATE_HZ, row):
            return k, text
    return -1, ""


def noise(samples: int) -> NDArray[np.float64]:
    return np.random.default_rng(1).standard_normal((samples, 4)) * LOW_NOISE_V


@pytest.mark.parametrize("channel", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_reading___that_is_not_a_number___is_found_at_once(channel: int, value: float) -> None:
    volts = noise(50)
    volts[20:, channel] = value
    assert first_complaint(volts) == (20, f"{CHANNEL_NAMES[channel]} is not a number")


@pytest.mark.parametrize("name", CHANNEL_NAMES)
def test_channel___without_a_sensor___need_only_be_a_number(name: str) -> None:
    channel = CHANNEL_NAMES.index(name)
    # The arm turns far: position and integrated speed agree while both are measured.
    run = driven(SimulatedRig(seed=3), hold, 900, RATE_HZ)
    volts = run.y.copy()
    volts[:, channel] = 0.0
    samples = list(zip(run.time_s.tolist(), volts, strict=True))
    of_four = SensorCheck(RATE_HZ)
    assert any(of_four.complaint(*sample) for sample in samples)
    check = SensorCheck(RATE_HZ, absent=[name])
    assert not any(check.complaint(*sample) for sample in samples)
    volts[0, channel] = math.nan
    assert check.complaint(10.0, volts[0]) == f"{name} is not a number"


@pytest.mark.parametrize("channel", range(4))
def test_equal_readings___thirty_in_a_row___are_a_stuck_sensor(channel: int) -> None:
    volts = noise(200)
    volts[100:, channel] = volts[100, channel]
    sample, text = first_complaint(volts)
    assert sample == 129
    assert text.startswith(f"{CHANNEL_NAMES[channel]} is stuck at ")
    volts[129, channel] += 0.01
    assert first_complaint(volts[:130]) == (-1, "")


@pytest.mark.parametrize(
    ("channel", "volts_v", "after"),
    [
        (0, 7.6, 2),
        (0, -9.995, 2),
        (1, INPUT_RANGE_V, 149),
        (2, -INPUT_RANGE_V, 149),
        (3, 9.995, 29),
    ],
)
def test_reading_at_the_end_of_its_range___is_found_after_its_time(
    channel: int, volts_v: float, after: int
) -> None:
    volts = noise(400)
    volts[100:, channel] = volts_v + 1e-4 * noise(300)[:, 0] * (channel == 0)
    lenient = SensorLimits(disagreement_rad=1e3)
    sample, text = first_complaint(volts, lenient)
    assert sample == 100 + after
    assert text.startswith(f"{CHANNEL_NAMES[channel]} is ")
    assert text.endswith("saturated or open")


def test_arm_that_turns_while_its_position_stands___is_found_by_the_speed() -> None:
    """One rad/s: the memory lets the drift come to 25 degrees in one second."""
    volts = noise(600)
    volts[:, 3] += 0.2014
    sample, text = first_complaint(volts)
    assert "disagree" in text
    exact_s = -0.5 * math.log(1.0 - math.radians(25.0) / 0.5)
    assert sample == pytest.approx(exact_s * RATE_HZ, abs=20)


def test_offset_of_the_tachometer___does_not_add_up() -> None:
    volts = noise(3000)
    volts[:, 3] += 0.4 * 0.2014
    assert first_complaint(volts) == (-1, "")


def test_gap_in_time___is_not_integrated() -> None:
    check = SensorCheck(RATE_HZ, SensorLimits(stuck_samples=0))
    assert check.complaint(0.0, np.zeros(4)) == ""
    assert check.complaint(0.5, np.array([4.0, 0.0, 0.0, 0.0])) == ""
    assert "disagree" in check.complaint(0.5 + 1 / RATE_HZ, np.array([0.0, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limit___that_is_no_positive_number___is_refused(value: float) -> None:
    with pytest.raises(SettingError, match="max_position_v must be a positive number"):
        SensorLimits(max_position_v=value)
