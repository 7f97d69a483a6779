"""Instants of messages that have no numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_core.errors import DataError
from flexarm_ident.reading.tracks import Track, counted_periods, evened, lost_messages, track

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 5_000_000


def sent_ns(periods: np.ndarray) -> np.ndarray:
    return np.asarray(START_NS + np.rint(periods * PERIOD_NS).astype(np.int64))


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    jitter=st.floats(0.0, 0.05),
    drift=st.floats(-1e-3, 1e-3),
    lost=st.floats(0.0, 0.3),
)
def test_count___steady_clock___says_what_was_lost(
    seed: int, jitter: float, drift: float, lost: float
) -> None:
    rng = np.random.default_rng(seed)
    periods = np.flatnonzero(rng.random(800) >= lost)
    periods = periods[(periods < 300) | (periods > 315)]
    off = rng.uniform(-jitter, jitter, len(periods))
    found = counted_periods(sent_ns(periods * (1.0 + drift) + off))
    np.testing.assert_array_equal(found, periods - periods[0])


@pytest.mark.parametrize("scale", [0.05, 0.2, 0.5])
def test_count___late_arrivals_and_nothing_lost___goes_up_by_one(scale: float) -> None:
    late = np.random.default_rng(1).gamma(2.0, scale, 5000)
    arrived = sent_ns(np.sort(np.arange(5000.0) + late))
    np.testing.assert_array_equal(counted_periods(arrived), np.arange(5000))


def test_count___late_arrivals_and_some_lost___is_near() -> None:
    rng = np.random.default_rng(2)
    periods = np.flatnonzero(rng.random(5000) >= 0.001)
    periods = periods[(periods < 2000) | (periods > 2100)]
    arrived = sent_ns(np.sort(periods + rng.gamma(2.0, 0.2, len(periods))))
    wrong = counted_periods(arrived) - (periods - periods[0])
    assert abs(int(wrong[-1])) <= 2
    assert np.mean(np.abs(wrong) > 2) < 0.01


def test_even___arrivals_with_jitter___come_back_to_their_timer() -> None:
    late = np.random.default_rng(3).gamma(2.0, 0.2, 3000)
    arrived = Track("/x", sent_ns(np.sort(np.arange(3000.0) + late)), np.arange(3000.0))
    found, jitter_s, early_s = evened(arrived)
    # The mean delay stays: 0.4 periods.
    off = (found.times_ns - sent_ns(np.arange(3000.0) + 0.4)) / PERIOD_NS
    assert np.abs(off).max() < 0.05
    assert jitter_s == pytest.approx(0.005 * np.sqrt(2.0) * 0.2, rel=0.1)
    # The least delay is near 0.
    assert early_s == pytest.approx(0.005 * 0.4, rel=0.1)
    np.testing.assert_array_equal(found.values, arrived.values)


def test_even___losses_of_a_steady_sender___keep_their_places() -> None:
    rng = np.random.default_rng(4)
    periods = np.flatnonzero(rng.random(3000) >= 0.05)
    arrived = sent_ns(periods + rng.gamma(2.0, 0.02, len(periods)))
    found, *_ = evened(Track("/x", arrived, periods.astype(np.float64)))
    late = (found.times_ns - START_NS) / PERIOD_NS - found.values
    # What is within 0.1 periods of its instant counts as on time.
    assert np.abs(late - np.median(late)).max() < 0.12


@pytest.mark.parametrize("count", [20, 500])
def test_even___events___stay_as_they_are(count: int) -> None:
    steps = np.random.default_rng(5).uniform(0.2, 3.0, count)
    signal = Track("/x", sent_ns(np.cumsum(steps)), np.arange(float(count)))
    assert evened(signal) == (signal, 0.0, 0.0)
    assert lost_messages(signal.times_ns) == 0


def test_lost___steady_sender___is_counted() -> None:
    assert lost_messages(sent_ns(np.delete(np.arange(400.0), [7, 100, 101]))) == 3


def test_track___messages_out_of_order_and_twice___are_put_in_order() -> None:
    times_ns = START_NS + np.array([0, 20, 10, 30, 30, 40])
    found = track("/x", times_ns, np.array([0.0, 2.0, 1.0, 3.0, 9.0, np.nan]))
    assert (found.times_ns - START_NS).tolist() == [0, 10, 20, 30]
    assert found.values.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_track___one_instant___is_too_few() -> None:
    with pytest.raises(DataError, match=r"/x\.data has values at 1 instants: two or more"):
        track("/x.data", np.full(5, START_NS), np.zeros(5))
