"""Excitation signals against what section 2.4 says of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_core.channels import BOUND_V
from flexarm_daq.experiments.excitation import (
    EXCITATIONS,
    HOLD_S,
    VARYING_HZ,
    Bounded,
    Held,
    PeriodicRandom,
    Random,
    Square,
    VaryingSquare,
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
def test_every_excitation___keeps_to_its_magnitude_and_repeats_itself(
    name: str, magnitude_v: float, seed: int
) -> None:
    excitation = EXCITATIONS[name](magnitude_v, seed)
    first = signal(excitation, 2.0)
    excitation.reset()

    assert np.max(np.abs(first)) <= magnitude_v
    assert np.array_equal(signal(excitation, 2.0), first)
    assert np.array_equal(signal(EXCITATIONS[name](magnitude_v, seed), 2.0), first)


@pytest.mark.parametrize("name", ["periodic_random", "varying_square", "random", "bounded_random"])
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
