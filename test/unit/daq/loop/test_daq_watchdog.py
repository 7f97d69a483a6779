from __future__ import annotations

import math

import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.loop.watchdog import Watchdog


def test_watchdog___before_any_command___is_stale_without_a_lapse() -> None:
    watchdog = Watchdog(0.25)
    assert watchdog.stale(0.0)
    assert (watchdog.feeds, watchdog.lapses) == (0, 0)


def test_command___at_the_sample_that_completes_its_age___is_stale() -> None:
    watchdog = Watchdog(0.25, max_age_periods=3)
    watchdog.fed(10.0)
    assert [watchdog.stale(now_s) for now_s in (10.25, 10.5, 10.75)] == [False, False, True]


def test_samples___that_come_close_after_a_late_one___count_all_the_same() -> None:
    watchdog = Watchdog(0.25, max_age_periods=3)
    watchdog.fed(10.2)
    assert [watchdog.stale(now_s) for now_s in (10.25, 10.5, 10.75)] == [False, False, True]


@pytest.mark.parametrize(("now_s", "is_stale"), [(10.6, False), (10.65, True), (20.0, True)])
def test_missing_samples___count_by_their_time(now_s: float, is_stale: bool) -> None:  # noqa: FBT001 - a parameter of the test
    watchdog = Watchdog(0.25, max_age_periods=3)
    watchdog.fed(10.0)
    assert watchdog.stale(now_s) is is_stale


def test_lapse___seen_many_times___counts_once() -> None:
    watchdog = Watchdog(0.25)
    watchdog.fed(0.0)
    assert [watchdog.stale(now_s) for now_s in (1.0, 2.0, 3.0)] == [True] * 3
    assert watchdog.lapses == 1


def test_lapse___followed_by_a_command___is_over() -> None:
    watchdog = Watchdog(0.25)
    watchdog.fed(0.0)
    watchdog.stale(1.0)
    watchdog.fed(2.0)
    assert not watchdog.stale(2.5)
    assert watchdog.stale(2.75)
    assert (watchdog.feeds, watchdog.lapses) == (2, 2)


@pytest.mark.parametrize("period_s", [0.0, -1.0, math.nan, math.inf])
def test_period___not_positive___is_refused(period_s: float) -> None:
    with pytest.raises(SettingError, match="period_s must be positive"):
        Watchdog(period_s)


def test_age___below_one_period___is_refused() -> None:
    with pytest.raises(SettingError, match="max_age_periods must be at least 1"):
        Watchdog(0.25, max_age_periods=0)
