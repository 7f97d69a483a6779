from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_node.statistics import Rate, Window


def filled(size: int, values: list[float]) -> Window:
    window = Window(size)
    for value in values:
        window.add(value)
    return window


def test_empty_window___has_no_percentiles() -> None:
    assert all(math.isnan(value) for value in vars(Window(3).percentiles()).values())


def test_one_value___is_every_percentile() -> None:
    assert set(vars(filled(5, [-2.5]).percentiles()).values()) == {-2.5}


def test_window_that_is_not_full___counts_no_empty_places() -> None:
    percentiles = filled(100, [4.0, 2.0, 6.0]).percentiles()
    assert (percentiles.p50, percentiles.maximum) == (4.0, 6.0)


def test_full_window___forgets_the_oldest() -> None:
    percentiles = filled(3, [90.0, 80.0, 3.0, 1.0, 2.0]).percentiles()
    assert (percentiles.p50, percentiles.maximum) == (2.0, 3.0)


def test_percentiles___of_a_thousand_ranks___interpolate_linearly() -> None:
    percentiles = filled(1001, [float(k) for k in range(1001)]).percentiles()
    assert percentiles.p50 == 500.0
    assert percentiles.p99 == pytest.approx(990.0)
    assert percentiles.p999 == pytest.approx(999.0)
    assert percentiles.maximum == 1000.0


@given(st.integers(1, 30), st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60))
def test_any_values___median_and_maximum_of_the_last_ones(size: int, values: list[float]) -> None:
    last = sorted(values[-size:])
    percentiles = filled(size, values).percentiles()
    half = len(last) // 2
    median = last[half] if len(last) % 2 else (last[half - 1] + last[half]) / 2
    assert np.isclose(percentiles.p50, median)
    assert percentiles.maximum == last[-1]
    assert percentiles.p50 <= percentiles.p99 <= percentiles.p999 <= percentiles.maximum


def test_rate___is_the_growth_since_the_last_look() -> None:
    rate = Rate()
    assert math.isnan(rate.update(5, 100.0))
    assert rate.update(605, 102.0) == 300.0
    assert rate.update(605, 103.0) == 0.0


def test_rate___without_time_in_between___is_unknown() -> None:
    rate = Rate()
    rate.update(5, 100.0)
    assert math.isnan(rate.update(6, 100.0))
