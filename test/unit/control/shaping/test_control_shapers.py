"""Reference shapers against the closed forms of the vibration that they leave."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexarm_control.shaping.shapers import (
    EI_VIBRATION,
    LONGEST_PERIODS,
    SHAPERS,
    Vibration,
    shaper_parts,
)

DT_S = 1 / 300


def residual(parts: np.ndarray[tuple[int], np.dtype[np.float64]], mode: Vibration) -> float:
    """Return the vibration after the last part, over that of a whole step at that instant.

    Each part of a step excites exp(s t); the sum at the end has this magnitude.
    """
    s = (
        2.0
        * math.pi
        * mode.frequency_hz
        * complex(-mode.damping_ratio, math.sqrt(1.0 - mode.damping_ratio**2))
    )
    ages_s = DT_S * (len(parts) - 1 - np.arange(len(parts)))
    left = complex(np.sum(parts * np.exp(s * ages_s)))
    return abs(left) / math.exp(s.real * float(ages_s[0]))


@pytest.mark.parametrize("damping_ratio", [0.0, 0.03, 0.15])
@pytest.mark.parametrize("frequency_hz", [2.35, 7.1, 9.4, 23.0])
@pytest.mark.parametrize("name", ["zv", "zvd"])
def test_shaper___on_its_mode___leaves_no_vibration(
    name: str, frequency_hz: float, damping_ratio: float
) -> None:
    mode = Vibration(frequency_hz, damping_ratio)

    assert residual(shaper_parts(name, mode, DT_S), mode) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("frequency_hz", [2.35, 7.1, 9.4])
def test_minimum_jerk___on_its_mode___leaves_no_vibration_but_that_of_sampling(
    frequency_hz: float,
) -> None:
    mode = Vibration(frequency_hz, 0.0)

    assert residual(shaper_parts("jerk", mode, DT_S), mode) < 2e-3


@pytest.mark.parametrize("frequency_hz", [2.35, 7.1, 9.4])
def test_ei___on_its_mode_and_beside_it___leaves_what_it_allows(frequency_hz: float) -> None:
    mode = Vibration(frequency_hz, 0.0)
    parts = shaper_parts("ei", mode, DT_S)
    # (1 - V) / 2 + (1 + V) / 2 cos(pi f / f0) is zero here.
    ratio = math.acos(-(1.0 - EI_VIBRATION) / (1.0 + EI_VIBRATION)) / math.pi

    assert residual(parts, mode) == pytest.approx(EI_VIBRATION, rel=0.02)
    assert residual(parts, Vibration(ratio * frequency_hz, 0.0)) < 2e-3
    assert residual(parts, Vibration((2.0 - ratio) * frequency_hz, 0.0)) < 2e-3


def test_shapers___at_a_frequency_off_by_a_tenth___leave_less_the_more_robust_they_are() -> None:
    off = Vibration(1.1 * 7.1, 0.0)
    left = {name: residual(shaper_parts(name, Vibration(7.1, 0.0), DT_S), off) for name in SHAPERS}

    # |cos(pi f / 2 f0)| of two parts, its square of three.
    assert left["zv"] == pytest.approx(abs(math.cos(0.55 * math.pi)), rel=0.02)
    assert left["zvd"] == pytest.approx(left["zv"] ** 2, rel=0.02)
    assert left["ei"] < EI_VIBRATION


@pytest.mark.parametrize("frequency_hz", [2.0, 9.4, 45.0, 100.0])
@pytest.mark.parametrize("name", SHAPERS)
def test_parts___of_a_shaper___are_a_whole_and_soon_over(name: str, frequency_hz: float) -> None:
    parts = shaper_parts(name, Vibration(frequency_hz, 0.05), DT_S)

    assert parts.sum() == pytest.approx(1.0, abs=1e-12)
    assert parts.min() > -1e-12
    assert len(parts) <= LONGEST_PERIODS / frequency_hz / DT_S + 2
