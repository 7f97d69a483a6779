"""Best linear approximation of plants whose distortion is known: none, odd, or even."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexarm_core.errors import DataError
from flexarm_core.waves import Band, multisine
from flexarm_ident.diagnostics.best_linear import BestLinear, best_linear_approximation

DT_S = 0.005
PERIOD = 800
SPRING, DAMPING = 400.0, 4.0
NOISE = 2e-4


def excitation(seed: int, periods: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a multisine of odd lines and its lines."""
    wave = multisine(Band(0.25, 20.0, PERIOD * DT_S, odd=True), seed)
    return np.array([wave(k * DT_S) for k in range(periods * PERIOD)]), wave.harmonics


def oscillator(u: np.ndarray, *, coulomb: float = 0.0) -> np.ndarray:
    """Return positions of a mass on a spring at 3.2 Hz, with dry friction if asked."""
    fine = 10
    step_s = DT_S / fine
    position = speed = 0.0
    found = np.empty(len(u))
    for k, force in enumerate(u):
        found[k] = position
        for _ in range(fine):
            free = speed + step_s * (force - SPRING * position - DAMPING * speed)
            # Friction stops the mass, or slows it down by its level.
            speed = math.copysign(max(abs(free) - step_s * coulomb, 0.0), free)
            position += step_s * speed
    return found


def approximated(
    seed: int, *, coulomb: float = 0.0, square: float = 0.0, periods: int = 8
) -> BestLinear:
    """Return the approximation of the oscillator behind a characteristic, with noise."""
    u, harmonics = excitation(seed, periods)
    position = oscillator(u, coulomb=coulomb)
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(u))
    y = position + square * position**2 / position.std() + noise
    return best_linear_approximation(
        u, np.column_stack([y, -y]), dt_s=DT_S, period=PERIOD, harmonics=harmonics
    )


def largest_by_chance(found: BestLinear, lines: int, periods: int) -> float:
    """Return the level that noise passes in so many lines once in thousands of records.

    The powers of means of some periods are exponential about the noise's, and so the scatter of
    their mean is that power over the root of the lines.
    """
    return float(found.noise_level[0]) * math.sqrt(5.0 / (periods * math.sqrt(lines)))


@pytest.mark.slow
def test_linear_plant___shows_no_distortion_in_20_of_20_seeds() -> None:
    for seed in range(20):
        found = approximated(seed, periods=9)
        even, odd = 39, len(range(1, 80, 2)) - len(found.frequencies_hz)
        assert found.even_level[0] < largest_by_chance(found, even, 8)
        assert found.odd_level[0] < largest_by_chance(found, odd, 8)


@pytest.mark.parametrize("seed", range(3))
def test_linear_plant___has_its_response_and_noise(seed: int) -> None:
    found = approximated(seed)
    s = 2j * np.pi * found.frequencies_hz
    # The force is held for a period, which delays it by half of one.
    held = (1.0 - np.exp(-s * DT_S)) / (s * DT_S)
    exact = held / (s**2 + DAMPING * s + SPRING)

    low = found.frequencies_hz < 6.0
    np.testing.assert_allclose(found.response[low, 0], exact[low], rtol=0.05)
    np.testing.assert_allclose(found.response[:, 1], -found.response[:, 0])
    # White noise has an amplitude of 2 sigma / sqrt(n) at a line; that of the wave is the same at
    # each of them, and the root of the mean of its squares is that of the response's.
    amplitude = 2.0 * NOISE / math.sqrt(PERIOD)
    u, harmonics = excitation(seed, 1)
    line = 2.0 * np.abs(np.fft.rfft(u)[harmonics]) / PERIOD
    size = np.sqrt(np.mean(np.abs(line * found.response[:, 0]) ** 2))
    assert found.noise_level[0] * size == pytest.approx(amplitude, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_dry_friction___shows_as_odd_distortion_alone(seed: int) -> None:
    found = approximated(seed, coulomb=0.15)

    assert found.odd_level[0] > 3.0 * max(found.even_level[0], found.noise_level[0] / 8.0**0.5)


@pytest.mark.parametrize("seed", range(3))
def test_square_of_the_output___shows_as_even_distortion_alone(seed: int) -> None:
    found = approximated(seed, square=0.05)

    assert found.even_level[0] > 3.0 * max(found.odd_level[0], found.noise_level[0] / 8.0**0.5)


def test_record_of_two_periods___is_refused_with_its_length() -> None:
    u, harmonics = excitation(1, 2)

    with pytest.raises(DataError, match="record 2400 samples"):
        best_linear_approximation(u, u, dt_s=DT_S, period=PERIOD, harmonics=harmonics)
