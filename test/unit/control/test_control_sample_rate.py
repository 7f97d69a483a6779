from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_control.laws.registry import LAWS
from flexarm_control.sample_rate import TOLERANCE, SampleRate, suits


def rates_of(stamps_ns: list[int]) -> list[float]:
    meter = SampleRate()
    return [rate for stamp in stamps_ns if (rate := meter.add(stamp)) is not None]


@given(
    st.floats(50.0, 2000.0),
    st.integers(0, 2**62),
    st.lists(st.floats(0.0, 0.2), min_size=129, max_size=129),
    st.sets(st.integers(0, 128), max_size=20),
)
def test_sample_rate___jitter_and_some_late_samples___is_still_right(
    rate_hz: float, start_ns: int, jitter: list[float], late: set[int]
) -> None:
    periods = np.arange(129) + 0.3 * np.array(jitter)
    periods[sorted(late)] += 0.5
    stamps_ns = [start_ns + round(1e9 * period / rate_hz) for period in periods]
    measured = rates_of(stamps_ns)
    assert len(measured) == 2
    assert all(suits(rate_hz, each) for each in measured)
    assert not any(suits(rate_hz * 5 / 3, each) for each in measured)


def test_sample_rate___reset___forgets_what_was_before() -> None:
    meter = SampleRate()
    for k in range(60):
        meter.add(k * 1_000_000)
    meter.reset()
    measured = [meter.add(10**12 + k * 2_000_000) for k in range(65)]
    assert measured[:-1] == [None] * 64
    assert measured[-1] == pytest.approx(500.0)


@given(st.integers(-(2**62), 2**62))
def test_sample_rate___clock_that_stands___says_nothing(stamp_ns: int) -> None:
    assert rates_of([stamp_ns] * 130) == []


def test_suits___bounds() -> None:
    assert suits(300.0, 300.0 * (1.0 + 0.99 * TOLERANCE))
    assert not suits(300.0, 300.0 * (1.0 + 1.01 * TOLERANCE))
    assert not suits(300.0, 300.0 * (1.0 - 1.01 * TOLERANCE))


def test_law_rate___laws_with_dynamics_have_one___the_others_suit_any() -> None:
    any_rate = {"pd", "pdp", "pdpc", "pdpc_unconditional"}
    with_dynamics = {"pi", "ilqr", "lqg", "pdpc_plus", "pdpc_scheduled", "planned"}
    assert all(LAWS[name].rate_hz({}) is None for name in any_rate)
    assert all(LAWS[name].rate_hz({}) == pytest.approx(300.0) for name in with_dynamics)
    assert LAWS["pdpc_plus"].rate_hz({"rate_hz": 500.0}) == 500.0
