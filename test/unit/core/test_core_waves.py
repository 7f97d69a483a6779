"""Multisine against its Fourier series, in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from flexarm_core.errors import SettingError
from flexarm_core.waves import Band, multisine

RATE_HZ = 400.0


def sampled(band: Band, seed: int, periods: int = 1) -> np.ndarray:
    """Return a multisine sampled over whole periods."""
    wave = multisine(band, seed)
    return np.array([wave(k / RATE_HZ) for k in range(round(periods * band.period_s * RATE_HZ))])


@pytest.mark.parametrize("odd", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_multisine___has_equal_lines_in_its_band_alone(seed: int, *, odd: bool) -> None:
    band = Band(0.5, 40.0, 10.0, odd)
    wave = multisine(band, seed)
    lines = np.abs(np.fft.rfft(sampled(band, seed))) / (0.5 * band.period_s * RATE_HZ)

    within = np.zeros(len(lines), dtype=bool)
    within[wave.harmonics] = True
    # The peak between samples of the search is cut off, by half a percent at most.
    np.testing.assert_allclose(lines[within], wave.amplitudes[0], rtol=0.02)
    assert lines[~within].max() < 0.005 * wave.amplitudes[0] * np.sqrt(within.sum())
    assert wave.harmonics.min() >= 5
    assert wave.harmonics.max() <= 400
    if odd:
        assert set(wave.harmonics % 2) == {1}
        # Of 198 odd lines from 5 to 399 one in four is left out, of the last two one or none.
        assert len(wave.harmonics) in {148, 149}
    else:
        assert len(wave.harmonics) == 396


@pytest.mark.parametrize("seed", range(5))
def test_multisine___has_a_smaller_crest_factor_than_random_phases(seed: int) -> None:
    band = Band(0.2, 50.0, 10.0)
    wave = sampled(band, seed)

    assert np.abs(wave).max() <= 1.0
    crest = np.abs(wave).max() / np.sqrt(np.mean(wave**2))
    # A sine has 1.41; random phases of 499 lines have about the root of 2 log 499, 3.5.
    assert crest < 1.7


@pytest.mark.parametrize("seed", range(3))
def test_multisine___moves_a_free_mass_from_rest_without_drift(seed: int) -> None:
    band = Band(0.5, 20.0, 4.0)
    wave = sampled(band, seed, periods=5)
    position = cumulative_trapezoid(cumulative_trapezoid(wave)) / RATE_HZ**2
    swing = np.ptp(position[: round(4.0 * RATE_HZ)])

    assert np.ptp(position) < 1.3 * swing


def test_multisine___repeats_itself_and_differs_from_seed_to_seed() -> None:
    band = Band(0.5, 20.0, 4.0)
    first, other = sampled(band, 1, 2), sampled(band, 2, 2)
    half = len(first) // 2

    np.testing.assert_allclose(first[:half], first[half:], atol=1e-9)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.5


@pytest.mark.parametrize(
    ("band", "message"),
    [
        ((5.0, 2.0, 1.0), "must be below high_hz"),
        ((0.2, 0.3, 1.0), "choose a longer period"),
        ((0.2, 1000.0, 100.0), "choose a shorter period"),
    ],
)
def test_band_without_lines___is_refused(band: tuple[float, float, float], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        Band(*band)


def test_multisine_of_even_octaves___has_equal_power_in_each() -> None:
    wave = multisine(Band(0.25, 32.0, 40.0, octaves=True), 1)
    at_hz = wave.harmonics / 40.0
    octaves = [(at_hz >= low) & (at_hz < 2.0 * low) for low in 0.25 * 2.0 ** np.arange(7)]
    powers = [float(np.sum(wave.amplitudes[each] ** 2)) for each in octaves]

    # A sum over lines is a little more than the integral over an octave of ten lines.
    np.testing.assert_allclose(powers, powers[-1], rtol=0.06)
    # The peak is 1, so this is the crest factor.
    assert np.sqrt(2.0 / np.sum(wave.amplitudes**2)) < 1.7
