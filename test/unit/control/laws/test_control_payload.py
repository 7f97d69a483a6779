"""The payload estimator against the cantilever that it assumes, and on the simulated rig."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lsim

from flexarm_control.laws.payload import (
    MAX_PAYLOAD_KG,
    PayloadDetection,
    PayloadEstimate,
    PayloadEstimator,
)
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.simulation import simulate
from flexarm_core.errors import SettingError
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, THESIS_NOISE_V

DETECTION = PayloadDetection()
RATE_HZ = DETECTION.rate_hz


def cantilever(payload_kg: float, length_s: float = 3.0) -> np.ndarray:
    """Samples of an arm that obeys a y2'' + y2 = a K y4', moved by a smooth swing."""
    time_s = np.arange(0.0, length_s, 1.0 / RATE_HZ)
    swing = 2.0 * math.pi * 0.7
    speed_v = 0.3 * np.sin(swing * time_s) ** 2
    acceleration = 0.3 * swing * np.sin(2.0 * swing * time_s)
    a = (payload_kg + DETECTION.tare_kg) / DETECTION.cantilever_n_per_m
    gain = a * DETECTION.strain_per_speed_s2
    _, base_v, _ = lsim(([gain], [a, 0.0, 1.0]), acceleration, time_s)
    volts = np.zeros((len(time_s), 4))
    volts[:, 1], volts[:, 3] = base_v, speed_v
    return volts


def weighed(estimator: PayloadEstimator, volts: np.ndarray) -> PayloadEstimate:
    for sample in volts.tolist():
        estimator.step(sample)
    return estimator.estimate


@settings(max_examples=20)
@given(st.floats(0.0, 0.8))
def test_cantilever_without_noise___is_weighed_to_two_grams(payload_kg: float) -> None:
    estimate = weighed(PayloadEstimator(DETECTION), cantilever(payload_kg))

    assert estimate.payload_kg == pytest.approx(payload_kg, abs=0.002)
    assert estimate.detected


def test_noise_of_the_gauge___does_not_bias_the_weight() -> None:
    volts = cantilever(0.2)
    found = []
    for seed in range(20):
        noisy = volts.copy()
        noisy[:, 1] += 0.4 * np.random.default_rng(seed).standard_normal(len(volts))
        found.append(weighed(PayloadEstimator(DETECTION), noisy))

    weights_kg = np.array([each.payload_kg for each in found])
    scatter_kg = weights_kg.std(ddof=1)
    assert abs(weights_kg.mean() - 0.2) < 4.0 * scatter_kg / math.sqrt(len(found)) + 0.002
    assert np.mean([each.deviation_kg for each in found]) > 0.5 * scatter_kg


def test_arm_at_rest___has_no_weight() -> None:
    noise = np.random.default_rng(1).standard_normal((900, 4)) * LOW_NOISE_V

    estimate = weighed(PayloadEstimator(DETECTION), noise)

    assert not estimate.detected
    assert math.isinf(estimate.deviation_kg)


def test_payload_that_changes___is_weighed_again() -> None:
    estimator = PayloadEstimator(DETECTION)

    first = weighed(estimator, cantilever(0.05, 6.0))
    second = weighed(estimator, cantilever(0.35, 12.0))

    assert first.payload_kg == pytest.approx(0.05, abs=0.005)
    assert second.payload_kg == pytest.approx(0.35, abs=0.06)


@pytest.mark.parametrize("fault", [math.nan, math.inf])
def test_samples_that_are_not_finite___are_left_out(fault: float) -> None:
    volts = cantilever(0.3)
    broken = np.insert(volts, [100, 400], [[0.0, fault, 0.0, 0.0], [0.0, 0.0, 0.0, fault]], axis=0)

    expected = weighed(PayloadEstimator(DETECTION), volts)
    assert weighed(PayloadEstimator(DETECTION), broken) == pytest.approx(expected, rel=1e-9)


def test_reset___forgets_the_payload() -> None:
    estimator = PayloadEstimator(DETECTION)
    weighed(estimator, cantilever(0.3))

    estimator.reset()

    assert not estimator.estimate.detected
    assert weighed(estimator, cantilever(0.1)).payload_kg == pytest.approx(0.1, abs=0.002)


def test_heavier_than_any_payload___is_cut_off() -> None:
    estimate = weighed(PayloadEstimator(DETECTION), cantilever(2.0, 8.0))

    assert estimate.payload_kg == MAX_PAYLOAD_KG


def test_bandwidth_out_of_range___is_refused_with_its_range() -> None:
    with pytest.raises(SettingError, match=r"bandwidth_hz = 50 .* 0.2 to 10 Hz"):
        PayloadDetection(bandwidth_hz=50.0)


@pytest.mark.parametrize("noise_v", [LOW_NOISE_V, THESIS_NOISE_V], ids=["low", "thesis"])
@pytest.mark.parametrize(
    ("payload_kg", "setpoint_v"), [(0.0, 1.0), (0.2, 3.0), (0.3, 4.0), (0.4, 5.0)]
)
def test_simulated_rig___is_weighed_within_60_grams_by_its_first_step(
    payload_kg: float, setpoint_v: float, noise_v: tuple[float, float, float, float]
) -> None:
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg, noise_v=noise_v), seed=7)
    estimator = PayloadEstimator(DETECTION)

    run = simulate(rig, Pdpc(), np.full(round(2.0 * RATE_HZ), setpoint_v))
    for volts in run.y.tolist():
        estimator.step(volts)

    assert estimator.estimate.detected
    assert estimator.estimate.payload_kg == pytest.approx(payload_kg, abs=0.06)
