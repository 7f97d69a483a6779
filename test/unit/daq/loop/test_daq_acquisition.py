from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_daq.loop.acquisition import LockStep
from flexarm_daq.loop.commander import Command, Verdict
from flexarm_daq.loop.exchange import Record
from flexarm_daq.loop.limiter import LimiterSettings
from flexarm_daq.loop.safety import DriveState, Event
from flexarm_daq.rigs.rig_protocol import RigError, RigSample
from support.acquisition_bench import (
    PERIOD_S,
    TIMEOUT_S,
    Bench,
    Clock,
    at_once,
    never,
    reply,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    Answer = Callable[[Record], list[tuple[float, Command]]]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr("flexarm_daq.loop.acquisition.time", made)
    return made


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
    np.testing.assert_array_equal(second.volts, [0.0, 0.1, 0.2, 0.3])
    assert (first.command_v, first.compensation_v) == (0.0, 0.0)
    assert (second.command_v, second.compensation_v) == (2.5, 0.5)


@pytest.mark.parametrize("samples", [1, 2, 7])
def test_samples___are_the_exact_number_of_readings(clock: Clock, samples: int) -> None:
    bench = Bench(clock, at_once(lambda _: 1.0), virtual=True, samples=samples).run()
    assert len(bench.rig.read_times_s) == len(bench.link.records) == samples
    assert bench.acquisition.sequence == samples


def test_no_limit_on_samples___runs_until_told_to_stop(clock: Clock) -> None:
    stop = threading.Event()

    def answer(record: Record) -> list[tuple[float, Command]]:
        if record.sequence == 40:
            stop.set()
        return [(0.0, reply(record, 1.0))]

    bench = Bench(clock, answer, virtual=True, samples=0)
    bench.acquisition.run(stop)

    assert bench.acquisition.sequence == 40
    assert bench.rig.calls[-2:] == [("safe_stop", 0.0), ("close", 0.0)]


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


def test_pace___told_to_stop_in_a_long_period___does_not_wait_on(clock: Clock) -> None:
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
        with pytest.MonkeyPatch.context() as patch:
            made = Clock()
            patch.setattr("flexarm_daq.loop.acquisition.time", made)
            bench = Bench(
                made,
                lambda record: [
                    (waits_s[record.sequence % len(waits_s)], reply(record, record.time_s))
                ],
                virtual=True,
                samples=25,
                lockstep=LockStep(pace, TIMEOUT_S, is_answered=True),
            ).run()
        return [(each.sequence, each.time_s, *each[-3:]) for each in bench.link.records]

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
        future = command._replace(state_sequence=record.sequence + 1, effort_v=9.0)
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
    bench = Bench(clock, lambda _: [(0.0, Command(1, 0, 5.0, 0.0))], virtual=True, samples=3).run()
    assert bench.rig.writes == []
    assert bench.acquisition.refused == 2
    assert bench.acquisition.unanswered == 2


@pytest.mark.parametrize("max_age_periods", [1, 3, 5])
def test_silent_controller___drive_goes_to_zero_after_the_age(
    clock: Clock, max_age_periods: int
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(0.0, reply(record, 2.0))] if record.sequence == 4 else []

    bench = Bench(clock, answer, virtual=False, samples=15, max_age_periods=max_age_periods).run()

    # In force from sample 4 on; stale at the sample that completes the age.
    stale = 4 + max_age_periods
    assert bench.commands_v == [0.0] * 4 + [2.0] * (stale - 4) + [0.0] * (15 - stale)
    assert bench.rig.writes == [2.0, 0.0]
    assert bench.rig.write_times_s[-1] == pytest.approx((stale - 1) * PERIOD_S, rel=1e-6)
    assert {record.command_sequence for record in bench.link.records[stale:]} == {0}
    assert bench.watchdog.lapses == 1


def test_controller_that_comes_back___drives_again(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [] if 2 <= record.sequence < 9 else [(0.0, reply(record, 2.0))]

    bench = Bench(clock, answer, virtual=False, samples=11).run()
    assert bench.commands_v == [0.0, *[2.0] * 3, *[0.0] * 5, 2.0, 2.0]


def test_slew___is_counted_from_zero_after_a_lapse(clock: Clock) -> None:
    slow = LimiterSettings(max_slew_v_per_s=1.0 / PERIOD_S)  # one volt a period

    def answer(record: Record) -> list[tuple[float, Command]]:
        return [] if 4 <= record.sequence < 12 else [(0.0, reply(record, 10.0))]

    bench = Bench(clock, answer, virtual=True, samples=14, limits=slow).run()
    assert bench.rig.writes == [1.0, 2.0, 3.0, 0.0, 1.0, 2.0]
    assert bench.acquisition.limited == 5


def test_emergency_stop___holds_zero_to_the_end(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        if record.sequence == 4:
            bench.acquisition.emergency_stop()
        return [(0.0, reply(record, 2.0))]

    bench = Bench(clock, answer, virtual=True, samples=10)
    bench.run()

    assert bench.rig.writes == [2.0, 2.0, 2.0, 0.0]
    assert bench.commands_v == [0.0, *[2.0] * 4, *[0.0] * 5]
    assert bench.acquisition.unanswered == 0


def test_emergency_stop___before_the_run___never_drives(clock: Clock) -> None:
    bench = Bench(clock, at_once(lambda _: 2.0), virtual=True, samples=5)
    bench.acquisition.emergency_stop()
    bench.run()
    assert bench.rig.writes == []
    assert bench.commands_v == [0.0] * 5


def test_limits___that_act___are_counted(clock: Clock) -> None:
    efforts = {1: 5.0, 2: 11.0, 3: float("nan"), 4: -12.0, 5: 1.0}
    bench = Bench(
        clock, at_once(lambda record: efforts.get(record.sequence, 0.0)), virtual=True, samples=6
    ).run()
    assert bench.rig.writes == [5.0, 10.0, 0.0, -10.0, 1.0]
    assert bench.acquisition.limited == 3


def test_position_beyond_its_bound___stops_the_outward_drive(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        bench.rig.position_v = 6.6
        return [(0.0, reply(record, 3.0 if record.sequence < 3 else -3.0))]

    bench = Bench(clock, answer, virtual=True, samples=4)
    bench.run()
    assert bench.rig.writes == [3.0, 0.0, -3.0]
    assert bench.acquisition.limited == 1


@pytest.mark.parametrize("virtual", [True, False])
def test_rig_that_fails___is_stopped_and_closed_before_the_error(
    clock: Clock,
    virtual: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    bench = Bench(clock, at_once(lambda _: 2.0), virtual=virtual, samples=9)
    bench.rig.fails_at = 3
    with pytest.raises(RigError, match="a wire broke"):
        bench.run()
    assert bench.acquisition.sequence == 3
    assert bench.rig.calls[-2:] == [("safe_stop", 0.0), ("close", 0.0)]


def test_real_time___command_acts_when_it_arrives(clock: Clock) -> None:
    delay_s = PERIOD_S / 8
    bench = Bench(
        clock, lambda record: [(delay_s, reply(record, 1.0))], virtual=False, samples=4
    ).run()
    np.testing.assert_allclose(bench.rig.read_times_s, np.arange(4) * PERIOD_S)
    np.testing.assert_allclose(bench.rig.write_times_s, np.arange(3) * PERIOD_S + delay_s)
    assert bench.acquisition.missed == 0
    assert bench.acquisition.reply_s.percentiles().maximum == pytest.approx(delay_s, rel=0.01)


def test_real_time___command_that_comes_just_before_the_next_sample___acts_before_it(
    clock: Clock,
) -> None:
    delay_s = PERIOD_S - 1e-4
    bench = Bench(
        clock, lambda record: [(delay_s, reply(record, 1.0))], virtual=False, samples=4
    ).run()
    np.testing.assert_allclose(bench.rig.write_times_s, np.arange(1, 4) * PERIOD_S)
    assert [kind for kind, _ in bench.rig.calls[1:]] == [
        *["read", "write"] * 3,
        "read",
        "safe_stop",
        "close",
    ]
    assert bench.acquisition.unanswered == 0


@pytest.mark.parametrize("share", [0.5, 0.93, 0.95, 0.97, 1.5, 2.5])
def test_real_time___answers_however_late___leave_spare_time_in_every_second_period(
    clock: Clock, share: float
) -> None:
    bench = Bench(
        clock, lambda record: [(share * PERIOD_S, reply(record, 1.0))], virtual=False, samples=12
    ).run()
    assert np.diff([0, *bench.link.spared, 12]).max() <= 2


def test_first_record___tells_when_the_rigs_time_began() -> None:
    record = Record(1, 0.25, 100.0, np.zeros(4), 0.0, 0.0, 0)
    assert record.start_ns(now_ns=5_000_000_000, now_s=100.5) == 4_250_000_000


def test_real_time___spare_time_begins_with_the_answer(clock: Clock) -> None:
    delay_s = PERIOD_S / 8
    bench = Bench(
        clock, lambda record: [(delay_s, reply(record, 1.0))], virtual=False, samples=4
    ).run()
    np.testing.assert_allclose(bench.link.spare_times_s, np.arange(3) * PERIOD_S + delay_s)


def test_real_time___nobody_answers___spare_time_begins_with_the_sample(clock: Clock) -> None:
    bench = Bench(clock, never, virtual=False, samples=5).run()
    np.testing.assert_allclose(bench.link.spare_times_s, np.array([1, 3]) * PERIOD_S)


def test_lock_step___every_sample_has_spare_time(clock: Clock) -> None:
    bench = Bench(clock, at_once(lambda _: 1.0), virtual=True, samples=5).run()
    assert set(bench.link.spared) == {1, 2, 3, 4}


def test_lock_step___nobody_answers___every_second_sample_has_spare_time(clock: Clock) -> None:
    bench = Bench(clock, never, virtual=True, samples=9).run()
    assert np.diff([0, *bench.link.spared, 9]).max() <= 2


def test_real_time___late_answer_that_no_newer_one_overtook___still_acts(clock: Clock) -> None:
    bench = Bench(
        clock, lambda record: [(1.5 * PERIOD_S, reply(record, 1.0))], virtual=False, samples=4
    ).run()
    assert bench.rig.writes == [1.0, 1.0]
    assert bench.acquisition.refused == 0
    assert bench.acquisition.unanswered == 3


def test_real_time___slow_reading___skips_whole_periods_with_their_numbers_and_never_bursts(
    clock: Clock,
) -> None:
    bench = Bench(clock, never, virtual=False, samples=10)
    bench.rig.slow_reads_s[2] = 3.5 * PERIOD_S

    bench.run()

    # Reading 2 fills periods 2 to 5: 3 and 4 are missed, 5 is late, 6 is on time again.
    np.testing.assert_allclose(
        np.array(bench.rig.read_times_s) / PERIOD_S, [0, 1, 2, 5.5, 6, 7, 8, 9]
    )
    assert (bench.acquisition.missed, bench.acquisition.taken) == (2, 8)
    assert [record.sequence for record in bench.link.records] == [1, 2, 3, 6, 7, 8, 9, 10]


def test_real_time___answers_go_on_over_skipped_periods___from_one_commander(clock: Clock) -> None:
    count = iter(range(1, 100))

    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(0.0, Command(next(count), record.sequence, 2.0, 0.0))]

    bench = Bench(clock, answer, virtual=False, samples=30)
    bench.rig.slow_reads_s.update({5: 1.5 * PERIOD_S, 6: 9.5 * PERIOD_S, 7: 0.5 * PERIOD_S})
    bench.run()

    acquisition = bench.acquisition
    assert acquisition.sequence == 30
    assert acquisition.taken + acquisition.missed == 30
    assert acquisition.refused == 0
    assert acquisition.safety.reason == ""


@given(
    st.dictionaries(st.integers(1, 30), st.floats(0.0, 12.0), max_size=12),
)
def test_real_time___any_stalls___a_gap_in_the_numbers_is_a_gap_in_time(
    stalls: dict[int, float],
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        made = Clock()
        patch.setattr("flexarm_daq.loop.acquisition.time", made)
        bench = Bench(
            made,
            lambda record: [
                (stalls.get(len(bench.link.records), 0.0) * PERIOD_S, reply(record, 1.0))
            ],
            virtual=False,
            samples=120,
        )
        bench.rig.slow_reads_s.update({k: s * PERIOD_S for k, s in stalls.items()})
        bench.run()
    numbers = np.array([record.sequence for record in bench.link.records])
    periods = np.array([record.time_s for record in bench.link.records]) / PERIOD_S
    # Each sample is taken in the period of its number.
    late = periods - (numbers - 1)
    assert np.all(late > -1e-3)
    assert np.all(late < 1.0 + 1e-3)
    assert bench.acquisition.missed == numbers[-1] - len(numbers)


@pytest.mark.parametrize("virtual", [True, False])
@pytest.mark.parametrize("error", [RigError("a wire broke"), ZeroDivisionError("a defect")])
def test_whatever_is_raised___leaves_the_drive_at_zero_and_says_why(
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    virtual: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    bench = Bench(clock, at_once(lambda _: 2.0), virtual=virtual, samples=9)

    def publish(record: Record) -> None:
        if record.sequence == 4:
            raise error
        bench.link.records.append(record)

    monkeypatch.setattr(bench.link, "publish", publish)
    with pytest.raises(type(error), match=str(error)):
        bench.run()
    assert bench.rig.calls[-2:] == [("safe_stop", 0.0), ("close", 0.0)]
    assert bench.acquisition.safety.state is DriveState.OFF
    assert bench.acquisition.safety.reason == str(error)


def test_rig_that_cannot_be_opened___is_stopped_and_closed(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(clock, never, virtual=True, samples=9)

    def fail() -> None:
        raise RigError("in use")

    monkeypatch.setattr(bench.rig, "open", fail)
    with pytest.raises(RigError, match="in use"):
        bench.run()
    assert bench.rig.calls[-2:] == [("safe_stop", 0.0), ("close", 0.0)]


def test_short_reading___ends_the_run(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(clock, at_once(lambda _: 2.0), virtual=True, samples=9)
    monkeypatch.setattr(bench.rig, "read", lambda: RigSample(0.0, np.zeros(3)))
    with pytest.raises(RigError, match="short reading: 3 of 4 channels"):
        bench.run()
    assert bench.link.records == []


@pytest.mark.parametrize("next_s", [0.0, -1.0, float("nan")])
def test_rig_whose_clock_does_not_go_on___ends_the_run(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, next_s: float
) -> None:
    bench = Bench(clock, at_once(lambda _: 2.0), virtual=True, samples=9)
    times = iter([0.0, next_s])
    monkeypatch.setattr(bench.rig, "read", lambda: RigSample(next(times), np.zeros(4)))
    with pytest.raises(RigError, match="clock stands still"):
        bench.run()
    assert len(bench.link.records) == 1


def test_lock_step___told_to_stop_while_a_sample_waits___does_not_wait_on(clock: Clock) -> None:
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


def test_two_commanders___the_drive_is_held_at_zero(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        first = reply(record, 2.0)
        if record.sequence < 4:
            return [(0.0, first)]
        return [(0.0, first), (0.0, first._replace(effort_v=-3.0))]

    bench = Bench(clock, answer, virtual=True, samples=12).run()

    assert bench.commands_v[:5] == [0.0, 2.0, 2.0, 2.0, 2.0]
    assert bench.commands_v[5:] == [0.0] * 7
    assert -3.0 not in bench.rig.writes
    assert "two commanders" in bench.acquisition.safety.reason


def test_second_commander___of_other_count___is_refused_until_the_first_goes_on(
    clock: Clock,
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        first = reply(record, 2.0)
        second = Command(record.sequence - 4, record.sequence, -3.0, 0.0)
        return [(0.0, second), (0.0, first)] if record.sequence == 5 else [(0.0, first)]

    bench = Bench(clock, answer, virtual=True, samples=9).run()

    assert bench.acquisition.commander.verdicts[Verdict.FOREIGN] == 1
    assert -3.0 not in bench.rig.writes
    assert bench.commands_v[5:] == [0.0] * 4


def test_commander_that_starts_again___takes_over_after_a_silence(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        if 4 <= record.sequence < 8:
            return []
        if record.sequence < 4:
            return [(0.0, reply(record, 2.0))]
        return [(0.0, Command(record.sequence - 7, record.sequence, 3.0, 0.0))]

    bench = Bench(clock, answer, virtual=True, samples=11).run()
    assert bench.acquisition.safety.reason == ""
    assert bench.commands_v[8:] == [3.0] * 3
