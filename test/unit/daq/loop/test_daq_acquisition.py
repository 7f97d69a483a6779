from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_core.signals import Command
from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.limiter import LimiterSettings
from flexarm_daq.loop.safety import DriveState
from flexarm_daq.rigs.rig_protocol import RigError, RigSample
from support.acquisition_bench import (
    PERIOD_S,
    Bench,
    Clock,
    acquisition_clock,
    at_once,
    never,
    reply,
)

if TYPE_CHECKING:
    from flexarm_daq.loop.exchange import Record


def test_controller_that_comes_back___drives_again(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [] if 2 <= record.sequence < 9 else [(0.0, reply(record, 2.0))]

    bench = Bench(clock, answer, virtual=False, samples=11).run()
    assert bench.commands_v == [0.0, *[2.0] * 3, *[0.0] * 5, 2.0, 2.0]


def test_command___that_the_rig_did_not_take___is_recorded_as_the_rig_reports(
    clock: Clock,
) -> None:
    bench = Bench(clock, at_once(lambda _: 2.0), virtual=True, samples=5)
    bench.rig.reports = {2: (0.0,), 3: (1.5,)}
    assert bench.run().commands_v == [0.0, 2.0, 0.0, 1.5, 2.0]


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


def test_real_time___spare_time_begins_with_the_answer(clock: Clock) -> None:
    delay_s = PERIOD_S / 8
    bench = Bench(
        clock, lambda record: [(delay_s, reply(record, 1.0))], virtual=False, samples=4
    ).run()
    np.testing.assert_allclose(bench.link.spare_times_s, np.arange(3) * PERIOD_S + delay_s)


def test_real_time___nobody_answers___spare_time_begins_with_the_sample(clock: Clock) -> None:
    bench = Bench(clock, never, virtual=False, samples=5).run()
    np.testing.assert_allclose(bench.link.spare_times_s, np.array([1, 3]) * PERIOD_S)


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
        return [(0.0, Command(next(count), record.sequence, (2.0,), (0.0,)))]

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
    with acquisition_clock() as made:
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
@pytest.mark.parametrize(
    "error",
    [
        RigError("a wire broke"),
        ZeroDivisionError("a defect"),
        KeyboardInterrupt("somebody ends it"),
        SystemExit("the process ends"),
    ],
)
def test_whatever_is_raised___leaves_the_drive_at_zero_and_says_why(
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
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


@pytest.mark.parametrize("stops_at", [1, 3])
def test_real_time___asked_to_stop_in_a_long_period___does_not_wait_on(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, stops_at: int
) -> None:
    """At a rate of a sample in some minutes, whenever it is told."""
    bench = Bench(clock, never, virtual=False, samples=0)
    monkeypatch.setattr(bench.acquisition, "_period_s", 1000.0)
    wait, stop, waits = bench.link.wait, threading.Event(), []

    def note(timeout_s: float) -> Command | None:
        waits.append(timeout_s)
        if len(waits) == stops_at:
            stop.set()
        return wait(timeout_s)

    monkeypatch.setattr(bench.link, "wait", note)
    started_s = clock.now_s
    bench.acquisition.run(stop)
    assert len(bench.link.records) == 1
    assert clock.now_s - started_s < 1.0


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


def test_two_commanders___the_drive_is_held_at_zero(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        first = reply(record, 2.0)
        if record.sequence < 4:
            return [(0.0, first)]
        return [(0.0, first), (0.0, first._replace(efforts=(-3.0,)))]

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
        second = Command(record.sequence - 4, record.sequence, (-3.0,), (0.0,))
        return [(0.0, second), (0.0, first)] if record.sequence == 5 else [(0.0, first)]

    bench = Bench(clock, answer, virtual=True, samples=9).run()

    assert bench.acquisition.commander.verdicts[Verdict.FOREIGN] == 1
    assert -3.0 not in bench.rig.writes
    assert bench.commands_v[5:] == [0.0] * 4


def test_two_commanders_that_go_on___are_looked_up_once(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [
            (0.0, reply(record, 2.0)),
            (0.0, Command(record.sequence, record.sequence, (-3.0,), (0.0,))),
        ]

    bench = Bench(clock, answer, virtual=True, samples=50)
    looks = []

    def commanders() -> list[str]:
        looks.append(bench.acquisition.sequence)
        return ["/a", "/b"]

    monkeypatch.setattr(bench.link, "commanders", commanders)
    bench.run()

    assert len(looks) == 1
    assert bench.acquisition.safety.reason.endswith("who may command: /a, /b")
    assert bench.commands_v[3:] == [0.0] * 47


def test_commander_that_starts_again___takes_over_after_a_silence(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        if 4 <= record.sequence < 8:
            return []
        if record.sequence < 4:
            return [(0.0, reply(record, 2.0))]
        return [(0.0, Command(record.sequence - 7, record.sequence, (3.0,), (0.0,)))]

    bench = Bench(clock, answer, virtual=True, samples=11).run()
    assert bench.acquisition.safety.reason == ""
    assert bench.commands_v[8:] == [3.0] * 3
