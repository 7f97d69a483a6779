"""Waits of a sample for its answer in virtual time, and what ends them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_daq.loop.acquisition import LockStep
from flexarm_daq.loop.safety import Event
from support.acquisition_bench import PERIOD_S, TIMEOUT_S, Bench, Clock, reply

if TYPE_CHECKING:
    from flexarm_core.signals import Command
    from flexarm_daq.loop.exchange import Record


def test_lock_step___nobody_answers_any_more___costs_one_time_out_and_then_goes_at_the_pace(
    clock: Clock,
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [] if record.sequence in {2, 3, 4} else [(0.0, reply(record, 1.0))]

    started_s = clock.now_s
    bench = Bench(clock, answer, virtual=True, samples=9).run()

    assert bench.acquisition.unanswered == 3
    # Samples 2, 3 and 4 are followed at real time's pace, the others at once.
    assert clock.now_s - started_s == pytest.approx(TIMEOUT_S + 3 * PERIOD_S)
    assert bench.commands_v == [0.0, 1.0, *[0.0] * 3, *[1.0] * 4]
    assert bench.rig.writes[1] == 0.0
    assert bench.acquisition.safety.counts[Event.STALE] == 1


@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_lock_step___drive_is_held___no_sample_waits_for_an_answer(
    clock: Clock, factor: float
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        if record.sequence == 3:
            bench.acquisition.emergency_stop()
        return [(0.0, reply(record, 1.0))] if record.sequence <= 3 else []

    bench = Bench(
        clock,
        answer,
        virtual=True,
        samples=9,
        lockstep=LockStep(factor, TIMEOUT_S, is_answered=True),
    )
    bench.run()

    held = [record for record in bench.link.records if record.sequence > 3]
    assert [record.commands[0] for record in held[1:]] == [0.0] * 5
    taken_s = np.array([record.taken_s for record in held])
    np.testing.assert_allclose(np.diff(taken_s), PERIOD_S / (factor or 1.0), rtol=1e-6)


def old_commands(record: Record, count: int) -> list[tuple[float, Command]]:
    """Answer two samples, and the third with commands for the first, every 5 ms."""
    if record.sequence < 3:
        return [(0.0, reply(record, 1.0))]
    old = reply(record._replace(sequence=1), 1.0)
    return [(0.005 * k, old) for k in range(count)] if record.sequence == 3 else []


@pytest.mark.parametrize("count", [0, 200])
def test_lock_step___emergency_stop_while_a_sample_waits___ends_the_wait(
    clock: Clock, count: int
) -> None:
    """Also where commands go on that answer no sample."""

    def answer(record: Record) -> list[tuple[float, Command]]:
        if record.sequence == 3:
            bench.acquisition.emergency_stop()
        return old_commands(record, count)

    started_s = clock.now_s
    bench = Bench(clock, answer, virtual=True, samples=6)
    bench.run()

    assert clock.now_s - started_s < 0.1 * TIMEOUT_S
    # The fourth sample was taken while the last command was in force.
    assert bench.commands_v == [0.0, 1.0, 1.0, 1.0, 0.0, 0.0]
    assert bench.acquisition.safety.reason == "emergency stop"


def test_lock_step___commands_that_answer_no_sample_go_on___costs_one_time_out(
    clock: Clock,
) -> None:
    count = round(3.0 * TIMEOUT_S / 0.005)
    started_s = clock.now_s
    bench = Bench(clock, lambda record: old_commands(record, count), virtual=True, samples=4)
    bench.run()

    assert clock.now_s - started_s < 1.2 * TIMEOUT_S
    assert bench.acquisition.safety.counts[Event.STALE] == 1
