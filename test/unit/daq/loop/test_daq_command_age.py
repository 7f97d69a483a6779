from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_core.signals import Command
from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.safety import DriveState, Event
from support.acquisition_bench import PERIOD_S, Bench, Clock, reply

if TYPE_CHECKING:
    from flexarm_daq.loop.exchange import Record


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
    assert bench.acquisition.safety.counts[Event.STALE] == 1


@pytest.mark.parametrize("virtual", [True, False])
@pytest.mark.parametrize("age", [3, 5, 100, 3000])
def test_answers_to_an_old_sample___are_refused_and_never_drive(
    clock: Clock,
    age: int,
    virtual: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        sample = record.sequence - age
        return [(0.0, Command(record.sequence, sample, (2.0,), (0.0,)))] if sample > 0 else []

    bench = Bench(clock, answer, virtual=virtual, samples=age + 30).run()

    assert bench.rig.writes == []
    # The last sample ends the run before its command is taken.
    assert bench.acquisition.commander.verdicts == {Verdict.LATE: 29}
    assert bench.acquisition.refused == 29
    assert bench.acquisition.unanswered == age + 29


@pytest.mark.parametrize("share", [2.25, 3.25, 5.5, 100.5])
def test_constant_delay_above_two_periods___ends_at_zero(clock: Clock, share: float) -> None:
    """The controller first answers in time, and from sample 11 on too late."""

    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(0.0 if record.sequence <= 10 else share * PERIOD_S, reply(record, 2.0))]

    bench = Bench(clock, answer, virtual=False, samples=300).run()

    # Sample 13 is the first that is three periods after the last one with an answer in time.
    assert bench.commands_v == [0.0, *[2.0] * 12, *[0.0] * 287]
    assert bench.rig.write_times_s[-1] == pytest.approx(12 * PERIOD_S, rel=1e-6)
    assert bench.acquisition.safety.state is DriveState.OFF
    late = bench.acquisition.commander.verdicts[Verdict.LATE]
    assert late == pytest.approx(290 - share, abs=1.0)


@pytest.mark.parametrize("max_age_periods", [2, 3, 5])
@pytest.mark.parametrize("delay", [0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3.25, 4.25, 4.75, 5.25])
def test_constant_delay___of_any_length___never_pulses_the_drive(
    clock: Clock, delay: float, max_age_periods: int
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(delay * PERIOD_S, reply(record, 2.0))]

    bench = Bench(clock, answer, virtual=False, samples=30, max_age_periods=max_age_periods).run()

    # Within a period the arm would not show it: every write counts.
    drives = delay < max_age_periods - 1
    assert set(bench.rig.writes[:-1]) == ({2.0} if drives else set())
    assert bench.acquisition.safety.counts[Event.STALE] == 0


@pytest.mark.parametrize("share", [0.25, 1.25, 1.75])
def test_reply___to_an_older_sample___counts_from_that_sample(clock: Clock, share: float) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(share * PERIOD_S, reply(record, 2.0))]

    bench = Bench(clock, answer, virtual=False, samples=20).run()
    shown = bench.acquisition.reply_s.percentiles()
    assert shown.p50 == pytest.approx(share * PERIOD_S, rel=0.01)
    assert shown.maximum == pytest.approx(share * PERIOD_S, rel=0.01)


def test_late_answer___is_in_force_for_the_rest_of_its_age(clock: Clock) -> None:
    """It answers sample 4, arrives after sample 5, and is stale at sample 7."""

    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(1.25 * PERIOD_S, reply(record, 2.0))] if record.sequence == 4 else []

    bench = Bench(clock, answer, virtual=False, samples=10).run()
    assert bench.commands_v == [*[0.0] * 5, 2.0, 2.0, *[0.0] * 3]
    assert bench.rig.write_times_s == pytest.approx([4.25 * PERIOD_S, 6 * PERIOD_S], rel=1e-6)
