"""Modes from outputs alone, against the plants that made the records and an independent route."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy

from flexarm_core.errors import DataError
from flexarm_ident import IoData, identify_modes
from support.exhaustive import first_of, wide

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.estimation.output_only import OutputMode, OutputModes

SHAPES = np.array([[1.0, 0.5], [0.3, 1.0]])
SEEDS = wide(5, 20)


def record(y: FloatArray, rate_hz: float) -> IoData:
    names = tuple(f"accel_{axis}" for axis in "xyzabc"[: y.shape[1]])
    return IoData(np.empty((len(y), 0)), y, dt_s=1.0 / rate_hz, inputs=(), outputs=names)


def accelerations(
    modes: list[tuple[float, float]],
    force: FloatArray,
    rate_hz: float,
    *,
    shapes: FloatArray = SHAPES,
    noise: float = 0.1,
    seed: int = 0,
) -> FloatArray:
    """Return accelerations of modes with unit deviation, and noise; poles are exact."""
    y = np.zeros((len(force), len(shapes)))
    for (hz, damping), push, shape in zip(modes, force.T, shapes.T, strict=True):
        pole = np.exp(2.0 * np.pi * hz / rate_hz * complex(-damping, np.sqrt(1.0 - damping**2)))
        denominator = [1.0, -2.0 * pole.real, abs(pole) ** 2]
        y += np.outer(scipy.signal.lfilter([1.0, -2.0, 1.0], denominator, push), shape)
    rng = np.random.default_rng(seed)
    return np.asarray(y / y.std(axis=0) + noise * rng.standard_normal(y.shape))


def white(seconds: float, rate_hz: float, seed: int) -> FloatArray:
    rng = np.random.default_rng(1000 + seed)
    return rng.standard_normal((round(seconds * rate_hz), 2))


def sweep(rate_hz: float) -> FloatArray:
    """Return the force of a printer's resonance test: 5 to 133 Hz at 2 Hz a second, on both."""
    t = np.arange(round(64.0 * rate_hz)) / rate_hz
    force = (5.0 + 2.0 * t) * np.sin(2.0 * np.pi * (5.0 * t + t**2))
    return np.repeat(force[:, np.newaxis], 2, axis=1)


def nearest(found: OutputModes, hz: float) -> OutputMode:
    return min(found.modes, key=lambda mode: abs(mode.frequency_hz - hz))


CASES = {
    "white noise": ([(6.0, 0.03), (19.0, 0.02)], 200.0, SHAPES),
    "sweep": ([(38.0, 0.06), (61.0, 0.04)], 800.0, SHAPES),
    "close": ([(12.0, 0.01), (12.25, 0.01)], 200.0, np.array([[1.0, 0.5], [-0.5, 1.0]])),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", first_of(CASES))
@pytest.mark.exhaustive
def test_modes___of_many_records___are_within_their_deviations(case: str) -> None:
    plant, rate_hz, shapes = CASES[case]
    within = []
    for seed in range(SEEDS):
        force = sweep(rate_hz) if case == "sweep" else white(120.0, rate_hz, seed)
        found = identify_modes(
            record(accelerations(plant, force, rate_hz, shapes=shapes, seed=seed), rate_hz)
        )
        assert len(found.modes) == len(plant)
        for hz, damping in plant:
            mode = nearest(found, hz)
            within.append(abs(mode.frequency_hz - hz) <= 2.0 * mode.frequency_std_hz)
            assert mode.frequency_std_hz < 0.02 * hz
            assert mode.damping_ratio == pytest.approx(damping, rel=0.6)

    assert np.mean(within) >= 0.85


def test_modes___of_white_noise_force___are_where_the_peaks_of_welch_are() -> None:
    plant = CASES["white noise"][0]
    y = accelerations(plant, white(300.0, 200.0, 0), 200.0)
    found = identify_modes(record(y, 200.0))
    hz, power = scipy.signal.welch(y, 200.0, nperseg=4096, axis=0)

    for number, mode in enumerate(found.modes):
        near = np.abs(hz - mode.frequency_hz) < 2.0
        peak = power[near, number]
        above = hz[near][peak > 0.5 * peak.max()]
        assert above[0] < mode.frequency_hz < above[-1]
        assert np.argmax(np.abs(mode.shape)) == number
        ratio = abs(mode.shape[1 - number])
        assert 0.0 < ratio < 1.0


def test_modes___of_a_free_decay___have_the_logarithmic_decrement() -> None:
    force = np.zeros((4000, 1))
    force[100] = 1.0
    y = accelerations([(6.0, 0.03)], force, 200.0, shapes=SHAPES[:, :1], noise=1e-3)
    (mode,) = identify_modes(record(y, 200.0)).modes
    envelope = np.abs(scipy.signal.hilbert(y[:, 0]))
    # From the first second to the second one behind the blow.
    decrement = np.log(envelope[300] / envelope[500])

    assert mode.frequency_hz == pytest.approx(6.0, rel=2e-3)
    assert mode.damping_ratio * 2.0 * np.pi * 6.0 == pytest.approx(decrement, rel=0.05)


def test_lines___of_rotating_parts___are_reported_from_modes() -> None:
    y = accelerations(CASES["white noise"][0], white(60.0, 200.0, 1), 200.0)
    t = np.arange(len(y)) / 200.0
    y[:, 0] += np.sin(2.0 * np.pi * 11.0 * t)
    found = identify_modes(record(y, 200.0))
    (line,) = (each for each in found.found if each.is_line)

    assert line.frequency_hz == pytest.approx(11.0, abs=0.02)
    assert line.damping_ratio < 1e-3
    assert len(found.modes) == 2
    at_line = np.argmin(np.abs(found.frequencies_hz - 11.0))
    assert found.without_lines()[at_line, 0] < 0.1 * found.density[at_line, 0]


@pytest.mark.parametrize("kind", first_of(["white", "coloured", "walk"]))
@pytest.mark.slow
def test_noise___without_a_resonance___has_no_mode(kind: str) -> None:
    for seed in range(5):
        y = np.random.default_rng(seed).standard_normal((6000, 3))
        if kind == "coloured":
            y = scipy.signal.lfilter([1.0], [1.0, -0.9], y, axis=0)
        elif kind == "walk":
            y = np.cumsum(y, axis=0)
        assert not identify_modes(record(y, 100.0)).found


def test_modes___of_two_records_with_holes___are_those_of_the_plant() -> None:
    plant = CASES["white noise"][0]
    both = []
    for seed in range(2):
        y = accelerations(plant, white(60.0, 200.0, seed), 200.0, seed=seed)
        y[3000:3400] = np.nan
        y[5000] = np.nan
        both.append(record(y + 50.0, 200.0))
    found = identify_modes(both)

    assert [round(mode.frequency_hz) for mode in found.modes] == [6, 19]


def test_inputs___of_a_record___are_left_out() -> None:
    force = white(60.0, 200.0, 0)
    y = accelerations(CASES["white noise"][0], force, 200.0)
    driven = IoData(force[:, :1], y, dt_s=0.005, inputs=("u",), outputs=("accel_x", "accel_y"))

    found, alone = identify_modes(driven), identify_modes(record(y, 200.0))
    assert [mode.frequency_hz for mode in found.modes] == pytest.approx(
        [mode.frequency_hz for mode in alone.modes]
    )


def test_spectra___of_the_outputs___add_up_to_their_power() -> None:
    y = accelerations(CASES["white noise"][0], white(60.0, 200.0, 0), 200.0)
    found = identify_modes(record(y, 200.0))
    total = found.density.sum(axis=0) * found.frequencies_hz[0]

    assert total == pytest.approx(y.var(axis=0), rel=0.1)


def test_short_and_constant_records___are_refused_by_name() -> None:
    y = np.random.default_rng(0).standard_normal((50, 2))
    with pytest.raises(DataError, match="record longer"):
        identify_modes(record(y, 100.0))
    still = np.random.default_rng(0).standard_normal((5000, 2)) * [1.0, 0.0]
    with pytest.raises(DataError, match="accel_y does not vary"):
        identify_modes(record(still, 100.0))
