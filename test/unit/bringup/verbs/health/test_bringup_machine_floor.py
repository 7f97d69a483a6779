from __future__ import annotations

import pytest

from flexarm_bringup.verbs.health.realtime import Floor, sleep_floor
from flexarm_node.statistics import Percentiles


class Machine:
    """Clock of a machine that wakes late, and stalls once."""

    def __init__(self, late_s: float, stall_at_s: float = 1e9, stall_s: float = 0.0) -> None:
        self.now_s = 50.0
        self._late_s, self._stall_s = late_s, stall_s
        self._stall_at_s = self.now_s + stall_at_s

    def clock(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds + self._late_s
        if self.now_s >= self._stall_at_s:
            self.now_s += self._stall_s
            self._stall_at_s = 1e9


def floor_of(machine: Machine, rate_hz: float = 100.0, length_s: float = 10.0) -> Floor:
    return sleep_floor(rate_hz, length_s, machine.clock, machine.sleep)


def test_machine_that_wakes_late___is_late_by_that() -> None:
    floor = floor_of(Machine(late_s=0.002))
    assert (floor.periods, floor.missed) == (1000, 0)
    for figure_s in (floor.late.p50, floor.late.p999, floor.late.maximum):
        assert figure_s == pytest.approx(0.002, rel=0.01)
    assert floor.kept


def test_machine_that_stalls___misses_the_periods_of_the_stall() -> None:
    # It is back 75 ms after a deadline: of the seven that have passed, the last is met late.
    floor = floor_of(Machine(late_s=1e-4, stall_at_s=2.0, stall_s=0.075))
    assert floor.periods == 1000
    assert (floor.missed, floor.gaps) == (6, 1)
    assert floor.late.maximum == pytest.approx(0.075, rel=0.02)
    assert not floor.kept


@pytest.mark.parametrize(("stall_s", "gaps"), [(0.015, 0), (0.025, 0), (0.035, 1)])
def test_stall___of_two_left_out_periods___is_a_gap(stall_s: float, gaps: int) -> None:
    assert floor_of(Machine(late_s=1e-4, stall_at_s=2.0, stall_s=stall_s)).gaps == gaps


def test_stall_over_the_end___ends_the_measurement() -> None:
    floor = floor_of(Machine(late_s=1e-4, stall_at_s=9.0, stall_s=60.0))
    assert floor.missed < floor.periods == 1000
    assert not floor.kept


@pytest.mark.parametrize(
    ("p999_s", "missed", "kept"), [(0.4e-3, 0, True), (0.6e-3, 0, False), (0.4e-3, 1, False)]
)
def test_rate___is_kept___without_a_miss_and_with_half_of_the_period_left(
    p999_s: float, missed: int, *, kept: bool
) -> None:
    late = Percentiles(1e-5, 1e-4, p999_s, 5e-3)
    assert Floor(1000.0, late, 5000, missed, 0).kept is kept
