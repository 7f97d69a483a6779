"""Two clocks at one instant, whatever interrupts the reading."""

from __future__ import annotations

import itertools
import time

import pytest

from flexarm_node.stamps import beside_steady_clock


def test_beside_steady_clock___reading_that_is_interrupted___does_not_count() -> None:
    pauses_s = itertools.chain([0.05], itertools.repeat(0.0))

    def slow_clock_ns() -> int:
        now_ns = time.monotonic_ns()
        time.sleep(next(pauses_s))
        return now_ns

    time_ns, now_s = beside_steady_clock(slow_clock_ns)
    assert time_ns / 1e9 == pytest.approx(now_s, abs=0.02)
