from __future__ import annotations

import threading

import pytest

from flexarm_bags.sequence import sequence_of
from flexarm_daq.nodes.play_clock import Pacer, StandIn
from support.bag_samples import START_NS, arm_state
from support.serialised import stamp_of

PATIENCE_S = 30.0


class FakeClock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_position___of_a_running_play___follows_the_clock() -> None:
    clock = FakeClock()
    pacer = Pacer(clock=clock)
    clock.now_s += 2.5
    assert pacer.position_s == 2.5
    assert pacer.wait_for(2.5)


def test_position___while_stopped___stays() -> None:
    clock = FakeClock()
    pacer = Pacer(clock=clock)
    clock.now_s += 1.0
    pacer.stop()
    clock.now_s += 50.0
    assert (pacer.position_s, pacer.running) == (1.0, False)
    pacer.stop()
    pacer.start()
    pacer.start()
    clock.now_s += 0.5
    assert (pacer.position_s, pacer.running) == (1.5, True)


def test_wait___of_a_stopped_play___goes_on_with_start() -> None:
    pacer = Pacer(running=False)
    found: list[bool] = []
    waiting = threading.Thread(target=lambda: found.append(pacer.wait_for(0.0)))
    waiting.start()
    waiting.join(0.02)
    assert not found
    pacer.start()
    waiting.join(PATIENCE_S)
    assert found == [True]


@pytest.mark.parametrize("running", [True, False])
def test_wait___for_long___is_ended(*, running: bool) -> None:
    pacer = Pacer(running=running)
    found: list[bool] = []
    waiting = threading.Thread(target=lambda: found.append(pacer.wait_for(1e6)))
    waiting.start()
    pacer.end()
    waiting.join(PATIENCE_S)
    assert found == [False]
    assert not pacer.wait_for(0.0)


def test_stand_in___record_that_starts_again___is_numbered_on() -> None:
    stand_in = StandIn(START_NS)
    played = [
        stand_in.sample(arm_state(number, 5).raw, due_s)
        for due_s, number in enumerate([3, 4, 7, 3, 4, 7, 3])
    ]
    assert [sequence_of(raw) for raw in played] == [3, 4, 7, 8, 9, 12, 13]
    assert [stamp_of(raw) for raw in played] == [START_NS + k * 10**9 for k in range(7)]
