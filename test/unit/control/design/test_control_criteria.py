"""ITAE and step-response figures against closed forms."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest

from flexarm_control import ControlError, itae, step_figures
from flexarm_control.design.criteria import position_itae, strain_itae, strain_settling_s

DT_S = 1 / 300
TIME_S = np.arange(3000) * DT_S


def test_itae___constant_error___is_the_sum_of_the_times() -> None:
    assert itae(np.full(5, -2.0), dt_s=0.1) == pytest.approx(0.1 * 2.0 * 0.1 * (0 + 1 + 2 + 3 + 4))


def test_itae___exponential_error___is_its_integral() -> None:
    rate = 3.0

    value = itae(np.exp(-rate * TIME_S), dt_s=DT_S)

    assert value == pytest.approx(1 / rate**2, rel=1e-4)


def test_position_itae___any_set_point___is_normalised() -> None:
    rate, set_point_v = 2.0, -4.0
    position_v = set_point_v * (1 - np.exp(-rate * TIME_S))

    assert position_itae(position_v, set_point_v, dt_s=DT_S) == pytest.approx(0.25, rel=1e-4)


def test_strain_itae___two_exponentials___are_normalised_by_their_peaks() -> None:
    base_v, middle_v = -5.0 * np.exp(-2.0 * TIME_S), 0.1 * np.exp(-4.0 * TIME_S)

    assert strain_itae(base_v, middle_v, dt_s=DT_S) == pytest.approx(1 / 4 + 1 / 16, rel=1e-3)


def test_strain_itae___signal_of_zeros___counts_as_zero() -> None:
    base_v = np.exp(-2.0 * TIME_S)

    assert strain_itae(base_v, np.zeros_like(base_v), dt_s=DT_S) == pytest.approx(0.25, rel=1e-3)


@pytest.mark.parametrize("rate_hz", [100.0, 300.0, 1000.0])
@pytest.mark.parametrize("noise_v", [0.0, 0.02])
def test_strain_settling___damped_vibration___is_where_its_envelope_is_a_tenth(
    rate_hz: float, noise_v: float
) -> None:
    time_s = np.arange(round(10.0 * rate_hz)) / rate_hz
    decay_s, frequency_hz = 0.8, 2.0
    noise = np.random.default_rng(1).normal(0.0, noise_v, len(time_s))
    strain_v = np.exp(-time_s / decay_s) * np.cos(2.0 * np.pi * frequency_hz * time_s) + noise
    # It leaves the band at most half a period before its envelope does.
    assert strain_settling_s(strain_v, dt_s=1.0 / rate_hz) == pytest.approx(
        decay_s * math.log(10.0), abs=0.5 / frequency_hz
    )


def test_strain_settling___vibration_that_stays___is_never_over() -> None:
    time_s = np.arange(3000) / 300.0
    assert strain_settling_s(np.sin(12.0 * time_s), dt_s=1.0 / 300.0) == math.inf


def test_strain_settling___noise_or_nothing___is_over_at_once() -> None:
    noise_v = np.random.default_rng(1).normal(0.0, 0.1, 3000)
    assert strain_settling_s(noise_v, dt_s=1.0 / 300.0) == 0.0
    assert strain_settling_s(np.zeros(3000), dt_s=1.0 / 300.0) == 0.0


@pytest.mark.parametrize(("reference_v", "start_v"), [(3.0, 0.0), (-3.0, 3.0), (1.0, -2.0)])
def test_step_figures___first_order___are_the_closed_form(
    reference_v: float, start_v: float
) -> None:
    constant_s = 0.5
    position_v = reference_v + (start_v - reference_v) * np.exp(-TIME_S / constant_s)

    figures = step_figures(TIME_S, position_v, reference_v, start_v)

    assert figures.overshoot == 0.0
    assert figures.settling_s == pytest.approx(constant_s * math.log(20), abs=DT_S)
    assert figures.rise_s == pytest.approx(constant_s * math.log(9), abs=2 * DT_S)
    assert figures.mean_error_v == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("damping", [0.2, 0.4, 0.6])
def test_step_figures___second_order___overshoot_is_the_closed_form(damping: float) -> None:
    frequency = 6.0
    damped = frequency * math.sqrt(1 - damping**2)
    envelope = np.exp(-damping * frequency * TIME_S)
    ringing = np.cos(damped * TIME_S) + damping * frequency / damped * np.sin(damped * TIME_S)

    figures = step_figures(TIME_S + 7.0, 2.0 * (1 - envelope * ringing), 2.0)

    expected = math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    assert figures.overshoot == pytest.approx(expected, abs=2e-4)
    # The envelope bounds the settling time, one half-period of ringing below it.
    bound_s = -math.log(0.05 * math.sqrt(1 - damping**2)) / (damping * frequency)
    assert bound_s - math.pi / damped <= figures.settling_s <= bound_s + DT_S


def test_step_figures___error_of_the_last_2_s___is_its_mean() -> None:
    position_v = np.where(TIME_S[-1] - 2.0 > TIME_S, 0.0, 2.9)

    assert step_figures(TIME_S, position_v, 3.0).mean_error_v == pytest.approx(0.1)


def test_step_figures___short_record___is_used_whole() -> None:
    figures = step_figures(np.array([0.0, 0.1]), np.array([2.0, 3.0]), 3.0)

    assert figures.mean_error_v == pytest.approx(0.5)


def test_step_figures___outside_at_the_end___never_settles() -> None:
    position_v = np.where(TIME_S[-1] > TIME_S, 1.0, 1.06)

    assert step_figures(TIME_S, position_v, 1.0).settling_s == math.inf


def test_step_figures___below_90_percent___never_rises() -> None:
    position_v = np.full_like(TIME_S, 0.89)

    figures = step_figures(TIME_S, position_v, 1.0)

    assert figures.overshoot == 0.0
    assert figures.rise_s == math.inf
    assert figures.settling_s == math.inf
    # Why such a step is told before python-control is asked.
    with pytest.raises(IndexError):
        control.step_info(position_v, TIME_S, final_output=1.0)


def test_step_figures___always_inside___settles_at_once() -> None:
    assert step_figures(TIME_S, np.ones_like(TIME_S), 1.0).settling_s == 0.0


def test_step_figures___no_step___is_refused() -> None:
    with pytest.raises(ControlError, match="no step"):
        step_figures(TIME_S, TIME_S, 1.0, 1.0)


@pytest.mark.parametrize("samples", [0, 5])
def test_step_figures___lengths_differ_or_empty___is_refused(samples: int) -> None:
    with pytest.raises(ControlError, match="one time per position"):
        step_figures(TIME_S[:samples], TIME_S[: samples // 2], 1.0)
