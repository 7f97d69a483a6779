"""The simulated arm with sensors at its tip: what they tell, by the shape of the beam."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import load_rig
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.drivers.at_rest import read_at_rest
from flexarm_daq.drivers.registry import driven
from flexarm_daq.drivers.tip_rig import SENSORS, TipRig, TipSettings
from flexarm_daq.rigs.beam import _curvatures, arm_modes
from flexarm_daq.rigs.equations import ARM, MODES
from flexarm_daq.rigs.plant import Plant

HERE = Path(__file__).parent
RATE_HZ = 300.0
ALL = TipSettings(SENSORS)


def run(settings: TipSettings, commands_v: np.ndarray) -> np.ndarray:
    """Return the samples, (commands, sensors), each read before its command."""
    rig = TipRig(settings)
    rig.open()
    samples = []
    for command_v in commands_v:
        samples.append(rig.read()[1])
        rig.write([command_v])
    rig.close()
    return np.array(samples)


def test_tip___is_the_hub_and_the_integral_of_the_curvature() -> None:
    parameters = RigParameters(payload_kg=0.2)
    plant, modes = Plant(parameters), arm_modes(parameters)
    q = np.random.default_rng(3).standard_normal(MODES)
    plant.state[0, ARM:] = q

    # A cantilever on the hub: w(L) = L theta + the integral of (L - x) w''(x).
    length_m, count = parameters.length_m, 4800
    middles_m = length_m * (np.arange(count) + 0.5) / count
    curvature = np.array([_curvatures(parameters, at_m, modes.shapes) @ q for at_m in middles_m])
    bent_m = np.sum((length_m - middles_m) * curvature) * length_m / count
    expected = modes.hub_angle @ q + bent_m / length_m
    assert plant.tip()[0] == pytest.approx(expected, rel=1e-5)


def test_accelerometer___integrated_twice___is_the_way_of_the_tip() -> None:
    commands_v = np.repeat([2.0, -2.0, 1.0, 0.0], 60)
    samples = run(replace(ALL, payload_kg=0.2), commands_v)

    tip_m = samples[:, SENSORS.index("tip_rad")] * RigParameters().length_m
    speed_m_per_s = np.cumsum(samples[:, SENSORS.index("tip_m_per_s2")]) / RATE_HZ
    moved_m = np.cumsum(0.5 * (speed_m_per_s[1:] + speed_m_per_s[:-1])) / RATE_HZ
    assert np.abs(tip_m).max() > 0.05
    np.testing.assert_allclose(moved_m, tip_m[1:], atol=0.01 * np.abs(tip_m).max())


def test_sensors_of_the_thesis___without_noise___are_those_of_its_rig() -> None:
    commands_v = np.repeat([2.0, -2.0], 60)
    rig = SimulatedRig(RigParameters(noise_v=(0.0,) * 4), rate_hz=RATE_HZ)
    rig.open()
    expected = []
    for command_v in commands_v:
        expected.append(rig.read()[1])
        rig.write([command_v])

    np.testing.assert_allclose(run(ALL, commands_v)[:, :4], expected, atol=1e-12)


def test_camera___says_what_was_there_before_its_delay() -> None:
    commands_v = np.repeat([2.0, -2.0], 60)
    late = replace(ALL, delay_s=(0.0, 0.0, 0.0, 0.0, 0.01, 0.0))
    place = SENSORS.index("tip_rad")

    direct, seen = run(ALL, commands_v), run(late, commands_v)

    np.testing.assert_allclose(seen[3:, place], direct[:-3, place], atol=1e-12)
    np.testing.assert_allclose(np.delete(seen, place, 1), np.delete(direct, place, 1), atol=1e-12)


def test_packaged_rig___read_at_rest___is_complete_and_keeps_its_rate() -> None:
    description = load_rig("thesis-tip")
    reading = read_at_rest(driven(description, HERE), description, 0.5)
    assert reading.rate_hz == pytest.approx(description.rate_hz)
    noise = np.array(description.settings["noise"])
    np.testing.assert_allclose(reading.raw.std(axis=0), noise, rtol=0.35)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"sensors": ("position_v", "tip_rd")}, r"'tip_rd' \(nearest: tip_rad\)"),
        ({"noise": (0.1,)}, r"settings\.noise needs a number from 0 on for each of the 6 sensors"),
        ({"seed": -1}, r"settings\.seed = -1 must not be negative"),
        ({"payload_kg": -0.1}, r"payload_kg"),
    ],
)
def test_settings___that_do_not_do___are_refused(changes: dict[str, object], said: str) -> None:
    with pytest.raises(SettingError, match=said):
        TipRig(replace(ALL, **changes))  # type: ignore[arg-type]
