from __future__ import annotations

import math

import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.loop.watchdog import Watchdog, usual_age_periods

PERIOD_S = 0.25


def watchdog_at(*times_s: float, max_age_periods: int = 3) -> Watchdog:
    """Return a watchdog that has seen the samples 1, 2, ... at these times."""
    watchdog = Watchdog(PERIOD_S, max_age_periods)
    for sequence, time_s in enumerate(times_s, start=1):
        watchdog.stale(sequence, time_s)
    return watchdog


def test_watchdog___before_any_command___is_stale() -> None:
    watchdog = Watchdog(PERIOD_S)
    assert watchdog.stale(1, 0.0)
    assert watchdog.stale(2, PERIOD_S)


@pytest.mark.parametrize("arrival", [1, 2])
def test_command___whenever_it_arrives___is_stale_at_the_sample_that_completes_its_age(
    arrival: int,
) -> None:
    """The age counts from the first sample, which the command answers."""
    watchdog = watchdog_at(*(10.0 + PERIOD_S * k for k in range(arrival)))
    assert watchdog.in_time(1)
    watchdog.fed(1)
    stale = [watchdog.stale(k + 1, 10.0 + PERIOD_S * k) for k in range(arrival, 5)]
    assert stale == [k >= 3 for k in range(arrival, 5)]


@pytest.mark.parametrize("max_age_periods", [1, 2, 3, 10])
def test_command___within_a_period_of_its_full_age___is_not_in_time(max_age_periods: int) -> None:
    """With an age of one period it acts until the next sample."""
    watchdog = watchdog_at(*(PERIOD_S * k for k in range(50)), max_age_periods=max_age_periods)
    in_time = [watchdog.in_time(sequence) for sequence in range(51)]
    assert in_time == [sequence > 50 - max(1, max_age_periods - 1) for sequence in range(51)]


def test_age___by_default___is_three_periods() -> None:
    watchdog = Watchdog(PERIOD_S)
    watchdog.stale(1, 0.0)
    watchdog.fed(1)
    assert [watchdog.stale(k + 1, PERIOD_S * k) for k in (1, 2, 3)] == [False, False, True]


def test_samples___that_come_close_after_a_late_one___count_all_the_same() -> None:
    watchdog = watchdog_at(10.2)
    watchdog.fed(1)
    stale = [watchdog.stale(k, now_s) for k, now_s in ((2, 10.25), (3, 10.5), (4, 10.75))]
    assert stale == [False, False, True]


@pytest.mark.parametrize(("now_s", "is_stale"), [(10.625, False), (10.65, True), (20.0, True)])
def test_samples___that_come_late___count_by_their_time(now_s: float, is_stale: bool) -> None:  # noqa: FBT001 - a parameter of the test
    watchdog = watchdog_at(10.0)
    watchdog.fed(1)
    assert watchdog.stale(2, now_s) is is_stale


@pytest.mark.parametrize(("now_s", "in_time"), [(10.375, True), (10.4, False), (20.0, False)])
def test_command___for_a_sample_before_a_late_one___counts_by_the_time(
    now_s: float,
    in_time: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    watchdog = watchdog_at(10.0, now_s)
    assert watchdog.in_time(1) is in_time


@pytest.mark.parametrize(("sequence", "is_stale"), [(3, False), (4, True), (1000, True)])
def test_missing_samples___count_by_their_numbers(sequence: int, is_stale: bool) -> None:  # noqa: FBT001 - a parameter of the test
    watchdog = watchdog_at(10.0)
    watchdog.fed(1)
    assert watchdog.stale(sequence, 10.0 + PERIOD_S) is is_stale


def test_number___that_no_sample_has___is_not_in_time() -> None:
    watchdog = watchdog_at(10.0, max_age_periods=4)
    watchdog.stale(3, 10.5)
    assert [watchdog.in_time(sequence) for sequence in (0, 1, 2, 3, 4)] == [
        False,
        True,
        False,
        True,
        False,
    ]


def test_stale_command___followed_by_another___is_over() -> None:
    watchdog = watchdog_at(0.0)
    watchdog.fed(1)
    assert [watchdog.stale(k, PERIOD_S * (k - 1)) for k in range(2, 8)] == [False] * 2 + [True] * 4
    watchdog.fed(7)
    assert [watchdog.stale(k, PERIOD_S * (k - 1)) for k in range(8, 11)] == [False, False, True]


@pytest.mark.parametrize("period_s", [0.0, -1.0, math.nan, math.inf])
def test_period___not_positive___is_refused(period_s: float) -> None:
    with pytest.raises(SettingError, match="period_s must be positive"):
        Watchdog(period_s)


def test_age___below_one_period___is_refused() -> None:
    with pytest.raises(SettingError, match="max_age_periods must be at least 0"):
        Watchdog(0.25, max_age_periods=-1)


@pytest.mark.parametrize(
    ("rate_hz", "periods"), [(10.0, 3), (300.0, 3), (1000.0, 3), (1200.0, 4), (2000.0, 6)]
)
def test_usual_age___is_three_periods_and_at_least_three_milliseconds(
    rate_hz: float, periods: int
) -> None:
    assert usual_age_periods(rate_hz) == periods
    watchdog = Watchdog(1.0 / rate_hz)
    assert watchdog.longest_answer_s == pytest.approx((periods - 1) / rate_hz)
    watchdog.stale(1, 0.0)
    watchdog.fed(1)
    stale = [watchdog.stale(1 + k, k / rate_hz) for k in range(1, periods + 1)]
    assert stale == [False] * (periods - 1) + [True]
