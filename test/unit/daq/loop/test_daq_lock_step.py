from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_core.signals import Command
from flexarm_daq.loop.acquisition import LockStep
from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.exchange import Record
from support.acquisition_bench import (
    PERIOD_S,
    TIMEOUT_S,
    Bench,
    Clock,
    acquisition_clock,
    at_once,
    never,
    reply,
)


def test_lock_step___every_sample_answered___commands_act_between_their_samples(
    clock: Clock,
) -> None:
    bench = Bench(clock, at_once(lambda record: record.sequence / 4.0), virtual=True, samples=5)

    bench.run()

    assert bench.rig.writes == [0.25, 0.5, 0.75, 1.0]
    kinds = [kind for kind, _ in bench.rig.calls]
    assert kinds == ["open", *["read", "write"] * 4, "read", "safe_stop", "close"]
    assert bench.commands_v == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert [record.command_sequence for record in bench.link.records] == [0, 1001, 1002, 1003, 1004]
    assert [record.sequence for record in bench.link.records] == [1, 2, 3, 4, 5]
    acquisition = bench.acquisition
    assert (acquisition.unanswered, acquisition.refused, acquisition.missed) == (0, 0, 0)


def test_records___hold_the_sample_and_the_parts_of_the_command(clock: Clock) -> None:
    bench = Bench(
        clock, lambda record: [(0.0, reply(record, 2.0, 0.5))], virtual=True, samples=2
    ).run()

    first, second = bench.link.records
    assert (first.time_s, second.time_s) == (0.0, PERIOD_S)
    np.testing.assert_array_equal(second.outputs, [0.0, 0.1, 0.2, 0.3])
    assert (first.commands, first.compensations) == ((0.0,), (0.0,))
    assert (second.commands, second.compensations) == ((2.5,), (0.5,))


@pytest.mark.parametrize("samples", [1, 2, 7])
def test_samples___are_the_exact_number_of_readings(clock: Clock, samples: int) -> None:
    bench = Bench(clock, at_once(lambda _: 1.0), virtual=True, samples=samples).run()
    assert len(bench.rig.read_times_s) == len(bench.link.records) == samples
    assert bench.acquisition.sequence == samples


def test_no_limit_on_samples___runs_until_asked_to_stop(clock: Clock) -> None:
    stop = threading.Event()

    def answer(record: Record) -> list[tuple[float, Command]]:
        if record.sequence == 40:
            stop.set()
        return [(0.0, reply(record, 1.0))]

    bench = Bench(clock, answer, virtual=True, samples=0)
    bench.acquisition.run(stop)

    assert bench.acquisition.sequence == 40
    assert bench.rig.calls[-2:] == [("safe_stop", 0.0), ("close", 0.0)]


@pytest.mark.parametrize("factor", [0.01, 0.25, 1.0, 100.0])
def test_pace___every_sample_waits_for_the_wall_clock(clock: Clock, factor: float) -> None:
    bench = Bench(
        clock,
        at_once(lambda record: record.sequence / 4.0),
        virtual=True,
        samples=9,
        lockstep=LockStep(factor, TIMEOUT_S, is_answered=True),
    ).run()
    taken_s = np.array([record.taken_s for record in bench.link.records])
    np.testing.assert_allclose(np.diff(taken_s), PERIOD_S / factor, rtol=1e-6)
    assert bench.acquisition.real_time_factor == pytest.approx(factor)
    assert bench.commands_v == [0.0, *(k / 4.0 for k in range(1, 9))]


def test_pace___machine_that_stalls___stalls_the_arms_time_and_loses_nothing(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(20.25 * PERIOD_S if record.sequence == 4 else 0.0, reply(record, 1.0))]

    bench = Bench(
        clock,
        answer,
        virtual=True,
        samples=21,
        lockstep=LockStep(1.0, TIMEOUT_S, is_answered=True),
    ).run()

    assert [record.sequence for record in bench.link.records] == list(range(1, 22))
    taken_s = np.array([record.taken_s for record in bench.link.records])
    # No burst after the stall: each of the other periods is a whole one.
    np.testing.assert_allclose(
        np.diff(taken_s) / PERIOD_S, [1.0] * 3 + [20.25] + [1.0] * 16, rtol=1e-6
    )
    acquisition = bench.acquisition
    assert (acquisition.missed, acquisition.unanswered) == (0, 0)
    assert acquisition.real_time_factor == pytest.approx(20.0 / 39.25)


def test_pace___sample_late_by_less_than_a_period___is_made_up_for(clock: Clock) -> None:
    bench = Bench(
        clock,
        at_once(lambda _: 1.0),
        virtual=True,
        samples=6,
        lockstep=LockStep(1.0, TIMEOUT_S, is_answered=True),
    )
    bench.rig.slow_reads_s[2] = 1.75 * PERIOD_S
    bench.run()
    taken_s = np.array([record.taken_s for record in bench.link.records])
    np.testing.assert_allclose(
        (taken_s - taken_s[0]) / PERIOD_S, [0, 1, 3.75, 3.75, 4, 5], atol=1e-4
    )


def test_pace___nobody_is_there___the_arm_moves_on_from_the_first_sample(clock: Clock) -> None:
    started_s = clock.now_s
    bench = Bench(
        clock,
        never,
        virtual=True,
        samples=11,
        lockstep=LockStep(0.5, TIMEOUT_S, is_answered=False),
    ).run()
    assert clock.now_s - started_s == pytest.approx(20 * PERIOD_S)
    assert bench.acquisition.real_time_factor == pytest.approx(0.5)
    assert bench.rig.writes == []


def test_pace___commander_that_comes_late___is_waited_for_from_its_first_command_on(
    clock: Clock,
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [] if record.sequence < 5 else [(3.0 * PERIOD_S, reply(record, 1.0))]

    bench = Bench(
        clock,
        answer,
        virtual=True,
        samples=12,
        lockstep=LockStep(1.0, TIMEOUT_S, is_answered=False),
    ).run()

    # The answer to sample 5 comes after samples 6, 7 and 8: from then on each one is waited for.
    acquisition = bench.acquisition
    assert acquisition.commander.answered == 11
    assert acquisition.unanswered == 7
    assert np.diff([record.taken_s for record in bench.link.records])[-3:] == pytest.approx(
        3.0 * PERIOD_S, rel=1e-6
    )


def test_pace___asked_to_stop_in_a_long_period___does_not_wait_on(clock: Clock) -> None:
    stop = threading.Event()
    bench = Bench(
        clock,
        at_once(lambda _: 1.0),
        virtual=True,
        samples=0,
        lockstep=LockStep(1e-5, TIMEOUT_S, is_answered=True),
    )
    wait = bench.link.wait

    def note(timeout_s: float) -> Command | None:
        stop.set()
        return wait(timeout_s)

    bench.link.wait = note  # type: ignore[method-assign]
    started_s = clock.now_s
    bench.acquisition.run(stop)
    assert clock.now_s - started_s < TIMEOUT_S / 10


@given(
    factor=st.sampled_from([0.0, 0.02, 0.5, 1.0, 30.0]),
    delays=st.lists(st.floats(0.0, 0.9 * TIMEOUT_S), min_size=1, max_size=20),
)
def test_pace_and_delays___any___give_the_same_samples(factor: float, delays: list[float]) -> None:
    def commands(pace: float, waits_s: list[float]) -> list[tuple[float, ...]]:
        with acquisition_clock() as made:
            bench = Bench(
                made,
                lambda record: [
                    (waits_s[record.sequence % len(waits_s)], reply(record, record.time_s))
                ],
                virtual=True,
                samples=25,
                lockstep=LockStep(pace, TIMEOUT_S, is_answered=True),
            ).run()
        return [
            (each.sequence, each.time_s, *each.commands, *each.compensations)
            for each in bench.link.records
        ]

    assert commands(factor, delays) == commands(0.0, [0.0])


def test_lock_step___late_answer___is_refused_when_a_newer_one_acts(clock: Clock) -> None:
    early: list[Command] = []

    def answer(record: Record) -> list[tuple[float, Command]]:
        command = reply(record, float(record.sequence))
        if record.sequence == 2:
            early.append(command)
            return []
        late = [(0.0, early.pop())] if record.sequence == 4 else []
        return [(0.0, command), *late]

    bench = Bench(clock, answer, virtual=True, samples=6).run()

    assert bench.acquisition.refused == 1
    assert bench.acquisition.unanswered == 1
    assert bench.rig.writes == [1.0, 0.0, 3.0, 4.0, 5.0]


def test_duplicate_and_future_commands___are_refused_and_counted(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        command = reply(record, 1.0)
        future = command._replace(state_sequence=record.sequence + 1, efforts=(9.0,))
        return [(0.0, future), (0.0, command), (0.0, command)]

    bench = Bench(clock, answer, virtual=True, samples=3).run()

    # The duplicate of one sample is met while the answer to the next one is awaited.
    assert bench.rig.writes == [1.0, 1.0]
    assert bench.acquisition.commander.verdicts == {
        Verdict.ACCEPTED: 2,
        Verdict.AHEAD: 2,
        Verdict.DUPLICATE: 1,
    }
    assert bench.acquisition.refused == 3
    assert bench.acquisition.unanswered == 0
    assert bench.acquisition.safety.reason == ""


def test_answer_to_no_sample___is_refused(clock: Clock) -> None:
    bench = Bench(
        clock, lambda _: [(0.0, Command(1, 0, (5.0,), (0.0,)))], virtual=True, samples=3
    ).run()
    assert bench.rig.writes == []
    assert bench.acquisition.refused == 2
    assert bench.acquisition.unanswered == 2


def test_first_record___says_when_the_rigs_time_began() -> None:
    record = Record(1, 0.25, 100.0, np.zeros(4), (0.0,), (0.0,), 0)
    assert record.start_ns(now_ns=5_000_000_000, now_s=100.5) == 4_250_000_000


def test_lock_step___every_sample_has_spare_time(clock: Clock) -> None:
    bench = Bench(clock, at_once(lambda _: 1.0), virtual=True, samples=5).run()
    assert set(bench.link.spared) == {1, 2, 3, 4}


def test_lock_step___nobody_answers___every_second_sample_has_spare_time(clock: Clock) -> None:
    bench = Bench(clock, never, virtual=True, samples=9).run()
    assert np.diff([0, *bench.link.spared, 9]).max() <= 2


def test_lock_step___asked_to_stop_while_a_sample_waits___does_not_wait_on(clock: Clock) -> None:
    stop = threading.Event()
    bench = Bench(clock, never, virtual=True, samples=0)
    publish, wait = bench.link.publish, bench.link.wait
    waits: list[float] = []

    def note(timeout_s: float) -> Command | None:
        waits.append(timeout_s)
        stop.set()
        return wait(timeout_s)

    bench.link.publish, bench.link.wait = publish, note  # type: ignore[method-assign]
    started_s = clock.now_s
    bench.acquisition.run(stop)
    assert len(waits) == 1
    assert clock.now_s - started_s < TIMEOUT_S / 10
