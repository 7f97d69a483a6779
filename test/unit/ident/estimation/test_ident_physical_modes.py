from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from flexarm_daq import RigParameters
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident import IoData, identify, preprocess, read_bag
from flexarm_ident.diagnostics.stabilisation import RecurringMode
from flexarm_ident.estimation.physical_modes import JudgedMode, near_modes, recurring
from support.ident_systems import DT_S, arm_model, step_by_step
from support.project import BAGS


def test_recurring_modes___mains_hum_beside_the_arm___recurs_but_is_not_physical() -> None:
    rng, samples = np.random.default_rng(1), 8000
    u = rng.normal(size=(samples, 1))
    y = step_by_step(arm_model(), u)
    hum = np.sin(2.0 * np.pi * 100.0 * DT_S * np.arange(samples))[:, np.newaxis]
    y += y.std(axis=0) * (0.05 * hum + 0.02 * rng.normal(size=y.shape))
    found = identify(IoData(u, y, dt_s=DT_S), method="orse_iv", block_rows=30).recurring_modes
    judged = {round(each.mode.frequency_hz, 0): each.is_physical for each in found}
    assert judged == {9.0: True, 24.0: True, 46.0: True, 100.0: False}
    (hummed,) = (each for each in found if not each.is_physical)
    assert hummed.weight < 0.02


def test_recurring___mode_of_a_model_of_low_order___is_the_physical_one_that_drifts() -> None:
    found = identify(preprocess(read_bag(BAGS / "c_dat3_0g")), method="pbsid", order=12)
    kinds = {
        round(mode.frequency_hz): each and each.is_physical
        for mode in found.modes
        if mode.eigenvalue.imag > 0.0
        for each in [recurring(mode, found.recurring_modes)]
    }
    # Of the beam, beside two poles whose damping ratio is about 0.7.
    assert [kinds[hz] for hz in (9, 24, 45)] == [True, True, True]
    assert [kinds[hz] for hz in kinds.keys() - {9, 24, 45}] == [None, None]


@pytest.mark.parametrize(("bag", "payload_kg"), [("c_dat3_0g", 0.0), ("c_dat3_400g", 0.4)])
def test_recurring_modes___simulated_arm___physical_ones_are_those_of_its_beam(
    bag: str, payload_kg: float
) -> None:
    found = identify(preprocess(read_bag(BAGS / bag)), method="pbsid").recurring_modes
    physical_hz = [each.mode.frequency_hz for each in found if each.is_physical]
    true_hz = natural_frequencies_hz(RigParameters(payload_kg=payload_kg), len(physical_hz))
    np.testing.assert_allclose(physical_hz, true_hz, rtol=0.08)
    assert len(physical_hz) == 4


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("poles", "gain"), [([0.9], 1.0), ([0.95, 0.6], 1.0), ([0.9], 0.0)])
def test_recurring_modes___plant_without_a_vibration___are_none_of_it(
    poles: list[float], gain: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    u = rng.normal(size=6000)
    clean = lfilter([0.0, 1.0], np.poly(poles), u)
    y = gain * clean + 0.05 * clean.std() * rng.normal(size=6000)
    data = IoData(u, y, dt_s=0.01, inputs=("u",), outputs=("y",))
    found = identify(data).recurring_modes
    assert [each.mode.frequency_hz for each in found if each.is_physical] == []


def test_recurring_modes___beneath_strong_noise___are_still_those_of_the_plant() -> None:
    rng = np.random.default_rng(1)
    u = rng.normal(size=(6000, 1))
    y = step_by_step(arm_model(), u)
    y += y.std(axis=0) * rng.normal(size=y.shape)
    found = identify(IoData(u, y, dt_s=DT_S), method="orse_iv", block_rows=30).recurring_modes
    physical_hz = [round(each.mode.frequency_hz) for each in found if each.is_physical]
    assert physical_hz[:2] == [9, 24]


def close_pair(*shapes: tuple[complex, complex], std_hz: float = 0.001) -> list[JudgedMode]:
    modes = [
        RecurringMode(hz, 0.01, std_hz, 0.001, 9, 1.0, (9,), (hz,), np.array(shape))
        for hz, shape in zip((12.0, 12.25), shapes, strict=True)
    ]
    return [JudgedMode(mode, 1.0, is_physical=True) for mode in modes]


def test_near_modes___neighbours_of_other_shapes_at_fixed_distance___are_two() -> None:
    assert near_modes(close_pair((1.0, 1.0), (1.0, -0.8))) == []
    # One mode that is split has one shape, and noise moves it over the orders.
    assert near_modes(close_pair((1.0, 1.0), (1.0, 0.8))) == [(12.0, 12.25)]
    assert near_modes(close_pair((1.0, 1.0), (1.0, -0.8), std_hz=0.1)) == [(12.0, 12.25)]
