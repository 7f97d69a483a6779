from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_ident import DataError
from flexarm_ident.reading.grid import Grid, held, on_grid, place

START_NS = 1_700_000_000_000_000_000


def stamps_ns(periods: np.ndarray, rate_hz: float) -> np.ndarray:
    return START_NS + np.rint(periods / rate_hz * 1e9).astype(np.int64)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32),
    rate_hz=st.sampled_from([50.0, 300.0, 500.0, 32.7]),
    jitter=st.floats(0.0, 0.08),
    drift=st.floats(-2e-4, 2e-4),
    numbered=st.booleans(),
)
def test_place___holes_and_a_drifting_clock___each_sample_in_its_row(
    seed: int, rate_hz: float, jitter: float, drift: float, *, numbered: bool
) -> None:
    rng = np.random.default_rng(seed)
    rows = np.flatnonzero(rng.random(3000) > 0.1)
    rows = rows[(rows < 1200) | (rows > 1290)]
    off = np.clip(rng.normal(0.0, jitter / 2, len(rows)), -jitter, jitter)
    sequence = rows if numbered else np.arange(len(rows))
    grid = place(sequence, stamps_ns(rows * (1.0 + drift) + off, rate_hz))
    assert grid.kept.all()
    np.testing.assert_array_equal(grid.instants, rows - rows[0])
    assert grid.period_s == pytest.approx(1.0 / rate_hz, rel=1e-3)
    assert grid.lost == rows[-1] - rows[0] + 1 - len(rows)


def test_place___strong_jitter___numbers_place_and_stamps_say_how_far_off() -> None:
    rng = np.random.default_rng(1)
    late = np.clip(rng.normal(0.0, 0.3, 4000), -0.9, 0.9)
    instants = np.arange(4000) + late
    grid = place(np.arange(4000), stamps_ns(instants, 300.0))
    rising = instants > np.concatenate([[-np.inf], np.maximum.accumulate(instants)[:-1]])
    # Two that are nearly on time in one period count once.
    assert not np.any(grid.kept & ~rising)
    assert np.count_nonzero(grid.kept) > 0.99 * np.count_nonzero(rising)
    off = grid.instants - instants[grid.kept]
    # All are referred to one phase; what is nearly on time passes for on time.
    assert np.median(np.abs(off - np.median(off))) < 0.02
    assert np.abs(off - np.median(off)).max() < 0.25
    assert grid.period_s == pytest.approx(1.0 / 300.0, rel=1e-9)


def test_place___late_samples_and_stalls_without_numbers___is_reported_by_the_stamps() -> None:
    rows = np.array([*range(400), *range(470, 900), 903, *range(905, 1500)])
    instants = rows.astype(np.float64)
    instants[400] += 0.4
    grid = place(np.arange(len(rows)), stamps_ns(instants, 300.0))
    expected = rows.astype(np.float64)
    expected[400] += 0.4
    np.testing.assert_allclose(grid.instants, expected, atol=0.02)
    assert grid.lost == 1500 - len(rows)


def test_place___clock_set_while_the_numbers_go_on___leaves_no_hole() -> None:
    stamps = stamps_ns(np.arange(600.0), 300.0)
    stamps[300:] += 3600 * 10**9
    grid = place(np.arange(600), stamps)
    np.testing.assert_array_equal(grid.instants, np.arange(600))


@pytest.mark.parametrize("jitter", [0.0, 0.3])
@pytest.mark.parametrize("pause", [2 * 10**6, 3 * 10**8, 2**61 // 10**9])
def test_place___pause_of_stamps_and_numbers___takes_no_rows_of_its_own(
    pause: int, jitter: float
) -> None:
    """A file of 144 kB with two such samples made a grid of 3e8 rows."""
    late = np.clip(np.random.default_rng(2).normal(0.0, jitter, 3000), -0.4, 0.4)
    rows = np.arange(3000) + np.where(np.arange(3000) >= 1700, pause, 0)
    grid = place(rows, stamps_ns(rows + late, 300.0))
    assert grid.rows < 3 * 3000
    assert grid.pauses_s == pytest.approx((pause / 300.0,), rel=1e-3)
    assert grid.period_s == pytest.approx(1.0 / 300.0, rel=1e-3)
    steps = np.diff(grid.instants)
    assert steps[grid.kept[:1700].sum() - 1] == pytest.approx(3000.0, abs=2.0)
    assert np.delete(steps, grid.kept[:1700].sum() - 1) == pytest.approx(1.0, abs=0.9)


def test_place___hole_that_is_no_pause___keeps_its_length() -> None:
    rows = np.arange(3000) + np.where(np.arange(3000) >= 1700, 200_000, 0)
    grid = place(rows, stamps_ns(rows.astype(float), 300.0))
    assert grid.pauses_s == ()
    assert grid.rows == 203_000


@pytest.mark.parametrize("pauses", [[1001], [505, 505]], ids=["one is a pause", "two are many"])
def test_place___ten_samples_and_more_rows_than_a_hundred_for_each___are_at_the_bound(
    pauses: list[int],
) -> None:
    rows = np.concatenate([[0], np.cumsum([1] * (9 - len(pauses)) + pauses)])
    stamps = stamps_ns(rows.astype(float), 300.0)
    if len(pauses) == 1:
        assert place(rows, stamps).pauses_s == pytest.approx((1001 / 300.0,), rel=1e-3)
    else:
        with pytest.raises(DataError, match="many long pauses"):
            place(rows, stamps)


def test_place___late_first_sample_of_a_clock_that_jitters___is_in_the_first_row() -> None:
    late = np.random.default_rng(7).normal(0.0, 0.25, 2000).clip(-0.4, 0.4)
    late[0] = 0.8
    grid = place(np.arange(2000), stamps_ns(np.arange(2000) + late, 300.0))
    assert not grid.missing[0]


def test_place___many_pauses___are_refused() -> None:
    rows = np.cumsum(np.where(np.arange(3000) % 3 == 0, 400_000, 1))
    with pytest.raises(DataError, match=r"3000 samples in .* many long pauses; .* cut the record"):
        place(rows, stamps_ns(rows.astype(float), 300.0))


@pytest.mark.parametrize("stamps", [np.zeros(10, np.int64), np.arange(10, 0, -1)])
def test_place___clock_that_does_not_advance___raises(stamps: np.ndarray) -> None:
    with pytest.raises(DataError, match="the stamps do not advance"):
        place(np.arange(10), stamps)


def test_place___one_sample___raises() -> None:
    with pytest.raises(DataError, match="no two samples"):
        place(np.array([1]), np.array([START_NS]))


def test_on_grid___sine_at_scattered_instants___is_the_sine_at_the_rows() -> None:
    rng = np.random.default_rng(2)
    instants = np.arange(400.0) + np.clip(rng.normal(0.0, 0.15, 400), -0.4, 0.4)
    instants[50] = 50.0
    omega = 2.0 * np.pi * 9.0 / 300.0
    values = np.stack([np.sin(omega * instants), np.cos(omega * instants)], axis=1)
    rows = np.arange(5, 395)
    found = on_grid(instants, values, rows)
    exact = np.stack([np.sin(omega * rows), np.cos(omega * rows)], axis=1)
    np.testing.assert_allclose(found[45], values[50], rtol=0.0)
    # The parabola's error: the third derivative over 6, times the distances to three samples.
    np.testing.assert_allclose(found, exact, atol=omega**3 / 6.0 * 0.5 * 1.9 * 1.9)


def test_on_grid___sample_far_off_and_alone___is_missing() -> None:
    values = np.array([[1.0], [2.0], [3.0]])
    found = on_grid(np.array([0.0, 10.4, 20.2]), values, np.array([0, 10, 15, 20]))
    assert found[0, 0] == pytest.approx(1.0)
    assert np.isnan(found[[1, 2]]).all()
    assert found[3, 0] == pytest.approx(3.0)


@settings(max_examples=60)
@given(st.integers(0, 2**32))
def test_held___changes_at_any_instants___means_over_the_periods(seed: int) -> None:
    rng = np.random.default_rng(seed)
    instants = np.unique(np.concatenate([[0.0], np.round(rng.uniform(0.0, 20.0, 15), 2)]))
    values = rng.normal(size=(len(instants), 2))
    fine = (np.arange(25 * 1000) + 0.5) / 1000.0
    signal = values[np.searchsorted(instants, fine, side="right") - 1]
    means = signal.reshape(25, 1000, 2).mean(axis=1)
    np.testing.assert_allclose(held(instants, values, np.arange(25)), means, atol=1e-9)


def test_held___rows_before_the_first_change___have_its_value() -> None:
    # By hand: 7 from the start, 9 from 1.25 on.
    found = held(np.array([0.5, 1.25]), np.array([[7.0], [9.0]]), np.arange(-1, 4))
    np.testing.assert_allclose(found[:, 0], [7.0, 7.0, 8.5, 9.0, 9.0])


def test_on_grid___sample_just_beyond_half_a_period___is_that_of_the_next_row() -> None:
    instants = np.array([8.0, 9.0, 10.52, 12.0, 13.0])
    found = on_grid(instants, 2.0 * instants[:, np.newaxis], np.arange(9, 13))[:, 0]
    # The next row has it by the parabola, which is the line through values on a line.
    np.testing.assert_allclose(found, [18.0, np.nan, 22.0, 24.0])


def test_place___first_sample_that_is_late___keeps_its_lateness() -> None:
    instants = np.arange(600.0)
    instants[0] += 0.3
    grid = place(np.arange(600), stamps_ns(instants, 300.0))
    assert grid.instants[0] == pytest.approx(0.3, abs=0.02)
    np.testing.assert_allclose(grid.instants[1:], np.arange(1, 600), atol=1e-9)


def test_grid___more_samples_than_rows___has_lost_none() -> None:
    grid = Grid(0.01, np.ones(5, np.bool_), np.array([0.0, 1.0]), samples=5)
    assert grid.rows == 2
    assert grid.lost == 0
