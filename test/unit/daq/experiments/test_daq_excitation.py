"""Excitation signals against what section 2.4 says of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_core.channels import BOUND_V
from flexarm_core.waves import Band
from flexarm_daq.experiments.excitation import (
    EXCITATIONS,
    HOLD_S,
    MOVED_V,
    PAUSE_S,
    PULSE_S,
    VARYING_HZ,
    Bounded,
    Held,
    PeriodicRandom,
    Pulses,
    Random,
    Square,
    VaryingSquare,
    binary_sequence,
)

RATE_HZ = 300.0


def signal(excitation: object, length_s: float, position_v: float = 0.0) -> np.ndarray:
    """Commands at 300 Hz with the arm held at a position."""
    step = excitation.step  # type: ignore[attr-defined]
    return np.array([step(k / RATE_HZ, position_v) for k in range(round(length_s * RATE_HZ))])


def half_periods_s(commands: np.ndarray) -> np.ndarray:
    """Lengths between two changes of direction."""
    return np.diff(np.flatnonzero(np.diff(np.sign(commands)))) / RATE_HZ


@pytest.mark.parametrize("name", EXCITATIONS)
@settings(max_examples=20)
@given(magnitude_v=st.floats(0.0, 10.0), seed=st.integers(0, 2**31 - 1))
@pytest.mark.slow
def test_every_excitation___keeps_to_its_magnitude_and_repeats_itself(
    name: str, magnitude_v: float, seed: int
) -> None:
    excitation = EXCITATIONS[name](magnitude_v, seed)
    first = signal(excitation, 2.0)
    excitation.reset()

    assert np.max(np.abs(first)) <= magnitude_v
    assert np.array_equal(signal(excitation, 2.0), first)
    assert np.array_equal(signal(EXCITATIONS[name](magnitude_v, seed), 2.0), first)


@pytest.mark.parametrize(
    "name",
    [
        *("periodic_random", "varying_square", "random", "bounded_random"),
        *("multisine", "binary_sequence", "band_noise"),
    ],
)
def test_random_excitations___differ_from_seed_to_seed(name: str) -> None:
    make = EXCITATIONS[name]
    assert not np.array_equal(signal(make(1.0, 1), 5.0), signal(make(1.0, 2), 5.0))


def test_square___alternates_at_half_a_hertz_from_the_middle_of_a_half_period() -> None:
    commands = signal(Square(2.0), 20.0)

    assert set(commands) == {-2.0, 2.0}
    assert np.argmin(commands) == pytest.approx(0.5 * RATE_HZ)
    assert half_periods_s(commands) == pytest.approx(1.0)


def test_periodic_random___alternates_like_the_square_with_uniform_magnitudes() -> None:
    commands = signal(PeriodicRandom(2.0, seed=3), 200.0)

    assert np.array_equal(np.sign(commands), np.sign(signal(Square(1.0), 200.0)))
    # A uniform distribution on 0 to 2 V has mean 1 V and deviation 2 / sqrt(12) V.
    magnitudes = np.abs(commands)
    assert magnitudes.mean() == pytest.approx(1.0, abs=0.03)
    assert magnitudes.std() == pytest.approx(2.0 / np.sqrt(12.0), abs=0.02)


def test_varying_square___has_half_periods_of_its_band() -> None:
    commands = signal(VaryingSquare(1.5, seed=1), 300.0)
    lengths_s = half_periods_s(commands)

    assert set(np.abs(commands)) == {1.5}
    assert lengths_s.min() >= 0.5 / VARYING_HZ[1] - 1.0 / RATE_HZ
    assert lengths_s.max() <= 0.5 / VARYING_HZ[0] + 1.0 / RATE_HZ
    # A half-period back lies within one period, a half-period forth joins two.
    frequencies_hz = 0.5 / lengths_s[::2]
    assert frequencies_hz.mean() == pytest.approx(np.mean(VARYING_HZ), abs=0.15)


@pytest.mark.parametrize("seed", range(5))
def test_varying_square___does_not_drift(seed: int) -> None:
    rate_hz = 10_000.0
    excitation = VaryingSquare(1.0, seed)
    commands = [excitation.step(k / rate_hz, 0.0) for k in range(round(10.0 * rate_hz))]
    # Free motion of a unit mass; the swing of one period of length T is T^2 / 16.
    position = np.cumsum(np.cumsum(commands)) / rate_hz**2

    assert np.max(np.abs(position)) <= 1.1 / VARYING_HZ[0] ** 2 / 16.0


def test_random___is_uniform_between_both_signs_and_held() -> None:
    commands = signal(Random(2.0, seed=1), 200.0)

    assert commands.mean() == pytest.approx(0.0, abs=0.05)
    assert commands.std() == pytest.approx(4.0 / np.sqrt(12.0), abs=0.03)
    held = round(HOLD_S * RATE_HZ)
    assert np.all(commands.reshape(-1, held) == commands[::held, None])


@pytest.mark.parametrize("held", [None, Held(1)], ids=["constant", "random"])
def test_bounded___turns_at_the_bounds_and_only_there(held: Held | None) -> None:
    excitation = Bounded(1.0, held)

    def direction(position_v: float) -> float:
        return float(np.sign(excitation.step(0.02, position_v)))

    path = (0.0, 0.99 * BOUND_V, BOUND_V, BOUND_V + 0.5, -0.5, -BOUND_V, -BOUND_V - 0.1, 1.0)
    assert [direction(position_v) for position_v in path] == [1, 1, -1, -1, -1, 1, 1, 1]


def test_chirp___passes_through_its_band_evenly() -> None:
    band = Band(1.0, 21.0, 10.0)
    excitation = EXCITATIONS["chirp"](2.0, 0, band)
    commands = signal(excitation, 20.0)
    crossings_s = np.flatnonzero(np.diff(np.sign(commands[:3000]))) / RATE_HZ

    # The phase of an even rise from 1 to 21 Hz in 10 s is 1 t + 1 t^2 turns.
    turns = crossings_s + crossings_s**2
    np.testing.assert_allclose(np.diff(turns), 0.5, atol=0.15)
    np.testing.assert_allclose(commands[:3000], commands[3000:], atol=1e-6)
    assert np.max(np.abs(commands)) == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("period_s", [1.0, 5.0, 60.0])
def test_binary_sequence___has_the_correlation_of_maximum_length(period_s: float) -> None:
    sequence = binary_sequence(Band(0.1, 44.0, period_s), 3)
    count = len(sequence.bits)
    lags = np.fft.ifft(np.abs(np.fft.fft(sequence.bits)) ** 2).real

    assert count >= period_s / 0.01 > count / 2 - 1
    # One at no lag, and -1 / n at all others (Golomb).
    assert lags[0] == pytest.approx(count)
    np.testing.assert_allclose(lags[1:], -1.0, atol=1e-6 * count)


def test_band_noise___stays_in_its_band() -> None:
    commands = signal(EXCITATIONS["band_noise"](3.0, 1, Band(2.0, 20.0)), 200.0)
    power = np.abs(np.fft.rfft(commands)) ** 2
    frequencies_hz = np.fft.rfftfreq(len(commands), 1.0 / RATE_HZ)
    within = (frequencies_hz >= 1.5) & (frequencies_hz <= 25.0)

    assert power[within].sum() > 0.95 * power.sum()
    # Three deviations are the magnitude.
    assert commands.std() == pytest.approx(1.0, rel=0.1)


def test_pulses___grow_by_the_root_of_two_and_end_when_the_joint_has_moved() -> None:
    excitation = Pulses(8.0)
    pair_s = PAUSE_S + 2.0 * PULSE_S
    heights = []
    for number in range(8):
        begins_s = number * pair_s + PAUSE_S
        moved = number == 5
        heights.append(excitation.step(begins_s + 0.01, 0.0))
        assert excitation.step(begins_s + PULSE_S + 0.01, MOVED_V * moved) == -heights[-1]
        assert excitation.step(begins_s + 2.0 * PULSE_S + 0.01, MOVED_V * moved) == 0.0

    np.testing.assert_allclose(heights[:6], 8.0 / 32.0 * 2.0 ** (np.arange(6) / 2.0))
    assert heights[6:] == [0.0, 0.0]
    excitation.reset()
    assert excitation.step(PAUSE_S + 0.01, 0.0) == heights[0]


def test_pulses_on_a_joint_that_does_not_move___end_at_the_magnitude() -> None:
    assert np.max(signal(Pulses(8.0), 60.0)) == pytest.approx(8.0)
