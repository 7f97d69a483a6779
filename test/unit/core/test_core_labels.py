"""Tests of figures in words."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexarm_core.labels import decay, instant, named_twice, with_deviation


@pytest.mark.parametrize(
    ("value", "deviation", "text"),
    [
        (9.38712, 0.0524, "9.387 ± 0.052"),
        (0.0201, 0.00031, "0.02010 ± 0.00031"),
        (0.02, 0.0, "0.02 ± 0"),
        (45.72, 0.996, "45.7 ± 1.0"),
        (45.72, 12.4, "46 ± 12"),
        (1234.4, 150.0, "1234 ± 150"),
        (-0.001891, 0.0021, "-0.0019 ± 0.0021"),
        (123456.0, 23456.0, "123456 ± 2.3e+04"),
        (1.25e-12, 3.1e-13, "1.25e-12 ± 3.1e-13"),
        (1.0, math.inf, "1 ± inf"),
        (1.0, math.nan, "1 ± nan"),
        (9.38712, None, "9.387"),
    ],
)
def test_with_deviation__value___ends_where_its_deviation_ends(
    value: float, deviation: float | None, text: str
) -> None:
    assert with_deviation(value, deviation) == text


def test_with_deviation__value_alone___has_the_asked_decimals() -> None:
    assert with_deviation(0.05, None, decimals=4) == "0.0500"


def test_with_deviation__any_deviation___is_reported_within_five_percent() -> None:
    rng = np.random.default_rng(1)
    for exponent in range(-300, 300):
        value, deviation = rng.uniform(-1e6, 1e6), rng.uniform(1.0, 10.0) * 10.0**exponent
        shown, _, reported = with_deviation(value, deviation).partition(" ± ")
        assert float(reported) == pytest.approx(deviation, rel=0.0501)
        assert float(shown) == pytest.approx(value, rel=1e-8, abs=0.0501 * deviation)


@pytest.mark.parametrize(
    ("names", "said"),
    [("", ""), ("abc", ""), ("abcbca", "b is named twice"), ("aa", "a is named twice")],
)
def test_named_twice__names___give_the_first_that_was_there_before(names: str, said: str) -> None:
    assert named_twice(names) == said


def test_instant__row___has_its_time_since_the_first() -> None:
    assert instant(312, 1 / 300) == "1.04 s (row 312)"
    assert instant(0, 0.5) == "0 s (row 0)"


@pytest.mark.parametrize(
    ("time_constant_s", "said"),
    [(0.0025, "0.0025 s"), (0.6234, "0.62 s"), (45.0, "45 s"), (437.0, "440 s")],
)
def test_decay__positive_real_eigenvalue___is_its_time_constant(
    time_constant_s: float, said: str
) -> None:
    # After that time an exponential is down to 1/e, or up to e.
    eigenvalue = math.exp(-1.0) ** (0.005 / time_constant_s)
    assert decay(complex(eigenvalue), 0.005) == said
    assert decay(complex(1.0 / eigenvalue), 0.005) == f"grows, {said}"


@pytest.mark.parametrize("eigenvalue", [1.0 - 1e-8, 1.0, 1.0 + 1e-8])
def test_decay__eigenvalue_next_to_the_circle___is_an_integrator(eigenvalue: float) -> None:
    assert decay(complex(eigenvalue), 0.005) == "integrator"


@pytest.mark.parametrize("eigenvalue", [0.0, -4e-16, 1e-17j])
def test_decay__eigenvalue_of_zero___is_over_after_one_sample(eigenvalue: complex) -> None:
    assert decay(complex(eigenvalue), 0.005) == "one sample"


@pytest.mark.parametrize(
    ("eigenvalue", "said"),
    [
        (-0.5, "alternates, 0.0072 s"),
        (-1.2, "alternates, grows, 0.027 s"),
        (-1.0, "alternates"),
        (0.5 + 0.1j, ""),
        (-0.5 + 0.1j, ""),
    ],
)
def test_decay__eigenvalue_that_changes_its_sign___is_reported(
    eigenvalue: complex, said: str
) -> None:
    assert decay(complex(eigenvalue), 0.005) == said
