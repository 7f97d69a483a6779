from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.signals import MAX_CATCH_UP_S
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.rigs.plant import Plant
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V
from flexarm_daq.rigs.rig_protocol import Rig, RigError, RigSample

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

PERIOD_S = 1.0 / 300.0
DELAY_S = 0.0005
SILENT = RigParameters(noise_v=(0.0, 0.0, 0.0, 0.0), adc_bits=32, dac_bits=32)


class FakeClock:
    def __init__(self, now_s: float = 0.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s


def opened(**options: object) -> SimulatedRig:
    rig = SimulatedRig(**options)  # type: ignore[arg-type]
    rig.open()
    return rig


def feedback(volts: NDArray[np.float64]) -> float:
    return float(2.0 - volts[0] - 2.8 * volts[3])


def record(rig: SimulatedRig, samples: int) -> NDArray[np.float64]:
    rows = []
    for _ in range(samples):
        sample = rig.read()
        rows.append(np.append(sample.time_s, sample.outputs))
        rig.write([feedback(sample.outputs)])
    return np.array(rows)


def test_rig___simulated___is_a_rig() -> None:
    rig: Rig = SimulatedRig()
    rig.open()
    sample = rig.read()
    assert isinstance(sample, RigSample)
    assert sample.outputs.shape == (4,)
    rig.close()


def test_virtual_time___same_seed___gives_identical_numbers() -> None:
    first = record(opened(seed=3), 300)
    np.testing.assert_array_equal(record(opened(seed=3), 300), first)
    assert (record(opened(seed=4), 300)[:, 1:] != first[:, 1:]).any(axis=0).all()


def test_virtual_time___samples___stand_on_the_grid() -> None:
    time_s = record(opened(rate_hz=500.0), 100)[:, 0]
    np.testing.assert_allclose(time_s, np.arange(100) / 500.0, rtol=1e-15)


def test_virtual_time___command___acts_after_the_reply_delay() -> None:
    rig = opened(parameters=SILENT)
    plant = Plant(SILENT)
    rig.read()
    rig.write([3.0])
    plant.advance(0.0, DELAY_S)
    plant.advance(3.0, PERIOD_S - DELAY_S)
    np.testing.assert_allclose(rig.read().outputs, plant.outputs_v(), atol=1e-8)
    rig.write([-2.0])
    plant.advance(3.0, DELAY_S)
    plant.advance(-2.0, PERIOD_S - DELAY_S)
    np.testing.assert_allclose(rig.read().outputs, plant.outputs_v(), atol=1e-8)


def test_virtual_time___no_answer___keeps_the_command_in_force() -> None:
    rig = opened(parameters=replace(SILENT, loop_delay_s=0.0))
    plant = Plant(SILENT)
    rig.write([3.0])
    for _ in range(31):
        sample = rig.read()
    plant.advance(3.0, 30 * PERIOD_S)
    np.testing.assert_allclose(sample.outputs, plant.outputs_v(), atol=1e-3)
    assert sample.outputs[0] > 0.1


def test_real_time___clock_on_the_grid___is_virtual_time() -> None:
    clock = FakeClock()
    rig = opened(seed=5, clock=clock)
    rows = []
    for k in range(300):
        clock.now_s = k / 300.0
        sample = rig.read()
        rows.append(np.append(sample.time_s, sample.outputs))
        clock.now_s = k / 300.0 + DELAY_S
        rig.write([feedback(sample.outputs)])
    np.testing.assert_array_equal(rows, record(opened(seed=5), 300))


def test_real_time___epoch_of_the_clock___is_the_opening() -> None:
    clock = FakeClock(12345.0)
    rig = opened(clock=clock)
    clock.now_s += 0.25
    assert rig.read().time_s == 0.25


def test_real_time___clock_standing_still___reads_the_same_instant() -> None:
    clock = FakeClock()
    rig = opened(parameters=SILENT, clock=clock)
    rig.write([2.0])
    clock.now_s = 0.1
    first = rig.read()
    second = rig.read()
    assert first.time_s == second.time_s
    np.testing.assert_array_equal(first.outputs, second.outputs)


def test_real_time___long_gap___is_cut_short() -> None:
    clock = FakeClock()
    rig = opened(parameters=SILENT, clock=clock)
    plant = Plant(SILENT)
    rig.write([0.8])
    clock.now_s = 1e6
    sample = rig.read()
    plant.advance(0.8, MAX_CATCH_UP_S)
    assert sample.time_s == 1e6
    np.testing.assert_allclose(sample.outputs, plant.outputs_v(), atol=1e-8)
    clock.now_s += 0.01
    plant.advance(0.8, 0.01)
    np.testing.assert_allclose(rig.read().outputs, plant.outputs_v(), atol=1e-6)


def test_open___again___starts_afresh() -> None:
    rig = opened(seed=2)
    first = record(rig, 50)
    rig.close()
    rig.open()
    np.testing.assert_array_equal(record(rig, 50), first)


def test_noise___at_rest___has_the_stated_spread() -> None:
    rig = opened()
    volts = np.array([rig.read().outputs for _ in range(4000)])
    quantised = np.hypot(LOW_NOISE_V, 20.0 / 4096.0 / math.sqrt(12.0))
    np.testing.assert_allclose(volts.std(axis=0), quantised, rtol=0.06)
    np.testing.assert_allclose(volts.mean(axis=0), 0.0, atol=0.004)


def test_hum___at_rest___is_a_sine_of_the_mains_in_its_channels() -> None:
    rig = opened(parameters=replace(SILENT, hum_v=(0.0, 0.5, 0.2, 0.0)), seed=3)
    volts = np.array([rig.read().outputs for _ in range(300)])
    lines_v = np.abs(np.fft.rfft(volts, axis=0)) * 2.0 / 300.0
    np.testing.assert_allclose(lines_v[60], (0.0, 0.5, 0.2, 0.0), atol=1e-6)
    assert np.delete(lines_v, 60, axis=0).max() < 1e-6


def test_hum___beside_noise___leaves_the_noise_of_a_seed_as_it_is() -> None:
    quiet, humming = (
        record(opened(parameters=replace(SILENT, noise_v=LOW_NOISE_V, hum_v=hum_v)), 300)
        for hum_v in ((0.0,) * 4, (0.0, 0.5, 0.0, 0.0))
    )
    np.testing.assert_allclose(humming[:, [1, 3, 4]], quiet[:, [1, 3, 4]], atol=1e-12)
    assert np.std(humming[:, 2] - quiet[:, 2]) == pytest.approx(0.5 / math.sqrt(2.0), rel=0.01)


def test_converter___twelve_bit___reads_whole_steps() -> None:
    rows = record(opened(), 300)[:, 1:]
    codes = rows / (20.0 / 4096.0)
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-9)
    assert len(np.unique(np.rint(codes))) > 100


def test_converter___beyond_its_range___clips() -> None:
    rig = opened(parameters=replace(SILENT, noise_v=(0.0, 1e3, 0.0, 0.0), adc_bits=12))
    readings = [rig.read().outputs[1] for _ in range(100)]
    assert min(readings) == -10.0
    assert max(readings) == pytest.approx(10.0 - 20.0 / 4096.0)


@pytest.mark.parametrize(
    ("command_v", "applied_v"),
    [
        (1.0, 410 * 10.0 / 4096.0),
        (-1.0, -410 * 10.0 / 4096.0),
        (0.001, 0.0),
        (10.0, 4095 * 10.0 / 4096.0),
        (-1e9, -4095 * 10.0 / 4096.0),
    ],
)
def test_drive___twelve_bit_magnitude___applies_whole_steps(
    command_v: float, applied_v: float
) -> None:
    parameters = replace(SILENT, dac_bits=12, coulomb_friction_nm=0.0, backlash_deg=0.0)
    rig = opened(parameters=replace(parameters, loop_delay_s=0.0))
    plant = Plant(parameters)
    rig.write([command_v])
    rig.read()
    plant.advance(applied_v, PERIOD_S)
    np.testing.assert_allclose(rig.read().outputs, plant.outputs_v(), atol=1e-8)


def test_safe_stop___on_a_driven_rig___takes_the_drive_to_zero() -> None:
    rig = opened(parameters=replace(SILENT, loop_delay_s=0.0))
    rig.write([0.8])
    for _ in range(30):
        rig.read()
    rig.safe_stop()
    for _ in range(600):
        settled = rig.read()
    for _ in range(300):
        later = rig.read()
    assert later.outputs[0] == pytest.approx(settled.outputs[0], abs=0.02)
    assert abs(later.outputs[3]) < 1e-9


def test_safe_stop___in_any_state___never_raises() -> None:
    rig = SimulatedRig()
    rig.safe_stop()
    rig.close()
    rig.open()
    rig.safe_stop()
    rig.safe_stop()
    rig.close()
    rig.close()
    rig.safe_stop()


@pytest.mark.parametrize(
    "use", [lambda rig: rig.read(), lambda rig: rig.write([0.0])], ids=["read", "write"]
)
def test_use___of_a_closed_rig___is_refused(use: Callable[[SimulatedRig], object]) -> None:
    rig = SimulatedRig()
    with pytest.raises(RigError, match="not open: call open"):
        use(rig)
    rig.open()
    rig.close()
    with pytest.raises(RigError, match="not open: call open"):
        use(rig)


@pytest.mark.parametrize("command_v", [math.nan, math.inf, -math.inf])
def test_write___not_finite___is_refused(command_v: float) -> None:
    rig = opened()
    with pytest.raises(RigError, match="command_v must be finite"):
        rig.write([command_v])


@pytest.mark.parametrize("rate_hz", [0.0, -300.0, math.nan, math.inf])
def test_rate___not_positive___is_refused(rate_hz: float) -> None:
    with pytest.raises(SettingError, match="rate_hz must be positive"):
        SimulatedRig(rate_hz=rate_hz)


def test_loop_delay___not_within_the_period___is_refused() -> None:
    with pytest.raises(SettingError, match="loop_delay_s must be less than the period"):
        SimulatedRig(RigParameters(loop_delay_s=1.0 / 300.0))


def test_payload___changed_between_samples___takes_effect_without_a_jump() -> None:
    rig, light = opened(parameters=SILENT), opened(parameters=SILENT)
    rows = {rig: [], light: []}  # type: ignore[var-annotated]
    for k in range(60):
        if k == 30:
            rig.change_payload(0.4)
        for each, found in rows.items():
            found.append(each.read().outputs)
            each.write([3.0])
    changed, steady = np.array(rows[rig]), np.array(rows[light])
    assert rig.parameters.payload_kg == 0.4
    np.testing.assert_array_equal(changed[:30], steady[:30])
    # The sample at which the payload came shows where the arm is, with or without.
    np.testing.assert_allclose(changed[30, [0, 3]], steady[30, [0, 3]], atol=1e-6)
    assert steady[59, 0] > 1.02 * changed[59, 0]


def test_payload___impossible___is_refused() -> None:
    rig = opened()
    with pytest.raises(SettingError, match="payload_kg must not be negative"):
        rig.change_payload(-0.1)
    assert rig.parameters.payload_kg == 0.0


def test_disturbance___is_a_command_that_nobody_sent() -> None:
    at_once = replace(SILENT, loop_delay_s=0.0)
    disturbed = opened(parameters=replace(at_once, disturbance_v=-1.25))
    driven = opened(parameters=at_once)
    driven.write([-1.25])

    for _ in range(100):
        first, second = disturbed.read(), driven.read()
        np.testing.assert_allclose(first.outputs, second.outputs, atol=1e-8)
        disturbed.write([0.0])
        driven.write([-1.25])
    assert first.outputs[0] < -0.01
