from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_node.statistics import HISTOGRAM_EDGES_S, Rate, Window

TOLERANCE = 0.0051
"""Of bins that are 1 % wide."""


def filled(size: int, values: list[float]) -> Window:
    window = Window(size)
    for value in values:
        window.add(value)
    return window


def test_empty_window___has_no_percentiles() -> None:
    assert all(math.isnan(value) for value in vars(Window(3).percentiles()).values())


def test_one_value___is_every_percentile() -> None:
    found = vars(filled(5, [2.5e-3]).percentiles()).values()
    assert list(found) == [pytest.approx(2.5e-3, rel=TOLERANCE)] * 4


def test_window_that_is_not_full___counts_no_empty_places() -> None:
    percentiles = filled(100, [4.0, 2.0, 6.0]).percentiles()
    assert (percentiles.p50, percentiles.maximum) == pytest.approx((4.0, 6.0), rel=TOLERANCE)


def test_full_window___forgets_the_oldest() -> None:
    percentiles = filled(3, [90.0, 80.0, 3.0, 1.0, 2.0]).percentiles()
    assert (percentiles.p50, percentiles.maximum) == pytest.approx((2.0, 3.0), rel=TOLERANCE)


@pytest.mark.parametrize("duration_s", [-1.0, 0.0, 1e-9])
def test_shorter_than_any_bin___counts_as_the_shortest(duration_s: float) -> None:
    assert filled(3, [duration_s]).percentiles().maximum == pytest.approx(1e-6, rel=0.01)


def test_longer_than_any_bin___counts_as_the_longest() -> None:
    assert filled(3, [1e9, math.inf]).percentiles().p50 == pytest.approx(1e3, rel=0.01)


def test_histogram___of_durations___counts_each_between_its_edges() -> None:
    # Six bars a decade from 10 us on: 1 ms is the edge behind the twelfth.
    histogram = filled(9, [0.9e-3, 1.1e-3, 1.2e-3, 1e-6, 5.0]).histogram()
    assert len(histogram) == len(HISTOGRAM_EDGES_S) - 1 == 24
    assert {bar: count for bar, count in enumerate(histogram) if count} == {
        0: 1,
        11: 1,
        12: 2,
        23: 1,
    }
    assert sum(filled(3, [0.9e-3] * 5).histogram()) == 3
    assert not any(Window(3).histogram())


def test_two_thousand_durations___have_four_different_percentiles() -> None:
    percentiles = filled(2000, [1e-4 * k for k in range(1, 2001)]).percentiles()
    expected = [0.1, 0.198, 0.1998, 0.2]
    np.testing.assert_allclose(list(vars(percentiles).values()), expected, rtol=TOLERANCE)


@given(st.integers(1, 30), st.lists(st.floats(1e-6, 900.0), min_size=1, max_size=60))
def test_any_durations___percentiles_of_the_last_ones(size: int, values: list[float]) -> None:
    percentiles = filled(size, values).percentiles()
    expected = np.percentile(values[-size:], [50.0, 99.0, 99.9, 100.0], method="inverted_cdf")
    np.testing.assert_allclose(list(vars(percentiles).values()), expected, rtol=TOLERANCE)


def test_rate___is_the_growth_since_the_last_look() -> None:
    rate = Rate()
    assert math.isnan(rate.update(5, 100.0))
    assert rate.update(605, 102.0) == pytest.approx(300.0)
    assert rate.update(605, 103.0) == 0.0


def test_rate___without_time_in_between___is_unknown() -> None:
    rate = Rate()
    rate.update(5, 100.0)
    assert math.isnan(rate.update(6, 100.0))
