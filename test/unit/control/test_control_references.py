"""Reference profiles."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from flexarm_control import REFERENCES, ControlError, build_reference
from flexarm_control.references import Constant, Sine, Square, Step, Triangle, VaryingSquare
from flexarm_core.channels import TRAVEL_V

RATE_HZ = 300


def test_constant___any_time___is_constant() -> None:
    reference = Constant(-2.0)

    assert {reference(t) for t in (0.0, 0.1, 1e6)} == {-2.0}


def test_step___before_and_after___is_zero_then_amplitude() -> None:
    reference = Step(3.0, at_s=1.0)

    assert [reference(t) for t in (0.0, 0.999, 1.0, 50.0)] == [0.0, 0.0, 3.0, 3.0]


def test_step___default___starts_at_once() -> None:
    assert Step()(0.0) == 3.0


def test_square___period___starts_with_plus_and_turns_at_the_half() -> None:
    reference = Square(3.0, period_s=8.0)

    assert [reference(t) for t in (0.0, 3.99, 4.0, 7.99, 8.0, 12.0)] == [3, 3, -3, -3, 3, -3]


@pytest.mark.parametrize("period_s", [0.2, 0.7, 8.0, 10.0])
def test_square___sampled___switches_at_the_right_samples(period_s: float) -> None:
    reference = Square(1.0, period_s)
    half = round(period_s / 2 * RATE_HZ)

    wave = [reference(k * (1 / RATE_HZ)) for k in range(20 * half)]

    assert wave == [1.0 if (k // half) % 2 == 0 else -1.0 for k in range(20 * half)]


def _half_periods_s(reference: VaryingSquare, duration_s: float) -> list[float]:
    times = [0.001 * k for k in range(round(duration_s / 0.001))]
    switches = [0.0] + [b for a, b in pairwise(times) if reference(a) != reference(b)]
    return [b - a for a, b in pairwise(switches)]


def test_varying_square___half_periods___fill_the_range() -> None:
    lengths_s = _half_periods_s(VaryingSquare(3.0, 2.5, 5.0, seed=1), 400.0)

    assert min(lengths_s) >= 2.499
    assert max(lengths_s) <= 5.001
    assert min(lengths_s) < 2.7
    assert max(lengths_s) > 4.8
    assert sum(lengths_s) / len(lengths_s) == pytest.approx(3.75, abs=0.2)


def test_varying_square___values___are_plus_and_minus_the_amplitude() -> None:
    reference = VaryingSquare(3.0)

    assert reference(0.0) == 3.0
    assert {reference(0.1 * k) for k in range(200)} == {3.0, -3.0}


def test_varying_square___seed___decides_the_wave() -> None:
    waves = [
        [VaryingSquare(3.0, 2.5, 5.0, seed)(0.05 * k) for k in range(2000)] for seed in (4, 4, 5)
    ]

    assert waves[0] == waves[1]
    assert waves[0] != waves[2]


def test_varying_square___order_of_calls___does_not_matter() -> None:
    times = [0.3 * k for k in range(500)]
    forward, backward = VaryingSquare(seed=7), VaryingSquare(seed=7)

    assert [forward(t) for t in times] == [backward(t) for t in reversed(times)][::-1]


def test_varying_square___equal_lengths___is_the_square_wave() -> None:
    varying, square = VaryingSquare(2.0, 4.0, 4.0), Square(2.0, 8.0)

    assert all(varying(0.1 * k) == square(0.1 * k) for k in range(1000))


def test_varying_square___very_late___still_answers() -> None:
    assert abs(VaryingSquare(3.0)(1e9)) == 3.0


def test_varying_square___shortest_above_longest___is_refused() -> None:
    with pytest.raises(ControlError, match=r"shortest_s = 6 exceeds longest_s = 5"):
        VaryingSquare(3.0, 6.0, 5.0)


def test_travel___80_degrees___is_6_857_v() -> None:
    assert pytest.approx(6.857, abs=5e-4) == TRAVEL_V


@pytest.mark.parametrize("name", [name for name in REFERENCES if name != "multisine"])
@pytest.mark.parametrize("amplitude_v", [6.858, -6.858, math.nan, math.inf])
def test_reference___amplitude_beyond_the_travel___is_refused(
    name: str, amplitude_v: float
) -> None:
    with pytest.raises(ControlError, match=r"-6\.857 to 6\.857 V.*travel is \+-80 deg"):
        build_reference(name, {"amplitude_v": amplitude_v})


@pytest.mark.parametrize("name", REFERENCES)
def test_build_reference___value_out_of_range___is_refused_with_the_range(name: str) -> None:
    for spec in REFERENCES[name].parameters:
        with pytest.raises(ControlError) as refused:
            build_reference(name, {spec.name: spec.bounds[1] + 1})
        assert spec.range_text in str(refused.value)


def test_build_reference___every_value___reaches_the_reference() -> None:
    values = {"amplitude_v": 2.0, "shortest_s": 2.0, "longest_s": 4.0, "seed": 3}

    assert build_reference("varying_square", values) == VaryingSquare(2.0, 2.0, 4.0, 3)
    assert build_reference("constant", {"amplitude_v": 1.0}) == Constant(1.0)
    assert build_reference("step", {"amplitude_v": 1.0, "at_s": 2.0}) == Step(1.0, 2.0)
    assert build_reference("square", {"amplitude_v": 1.0, "period_s": 2.0}) == Square(1.0, 2.0)


def test_build_reference___unknown_name___lists_the_known() -> None:
    with pytest.raises(ControlError, match="no reference 'ramp'; choose one of constant, step"):
        build_reference("ramp")


def test_build_reference___unknown_parameter___lists_the_known() -> None:
    with pytest.raises(ControlError, match="constant has no parameter 'period_s'"):
        build_reference("constant", {"period_s": 1.0})


def test_waves___of_a_quarter_each___go_through_their_corners() -> None:
    times_s = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    for kind in (Sine, Triangle):
        wave = kind(2.0, period_s=4.0, offset_v=0.5)
        assert [wave(t) for t in times_s] == pytest.approx(
            [0.5, 2.5, 0.5, -1.5, 0.5, 2.5], abs=1e-6
        )
    assert Triangle(2.0, period_s=4.0)(0.5) == pytest.approx(1.0)
    assert Sine(2.0, period_s=4.0)(0.5) == pytest.approx(math.sqrt(2.0))
    assert Square(2.0, period_s=4.0, offset_v=-1.0)(3.0) == pytest.approx(-3.0)


@pytest.mark.parametrize("name", ["sine", "square", "triangle"])
def test_wave___out_of_the_travel___is_refused(name: str) -> None:
    with pytest.raises(ControlError, match="leaves the travel"):
        build_reference(name, {"amplitude_v": -5.0, "offset_v": 2.0})


def test_multisine___beyond_the_travel_and_of_odd_lines___is_that_of_its_seed() -> None:
    values = {"magnitude_v": 40.0, "low_hz": 0.5, "high_hz": 20.0, "period_s": 4.0, "seed": 2}
    reference = build_reference("multisine", values)
    wave = [reference(k / RATE_HZ) for k in range(4 * RATE_HZ)]

    assert max(map(abs, wave)) == pytest.approx(40.0, rel=0.01)
    lines = np.abs(np.fft.rfft(wave))
    # Even harmonics of the period, and all beyond 20 Hz.
    assert max(lines[::2].max(), lines[81:].max()) < 0.01 * lines.max()


def test_multisine_without_lines___is_refused() -> None:
    with pytest.raises(ControlError, match="must be below high_hz"):
        build_reference("multisine", {"low_hz": 60.0})
