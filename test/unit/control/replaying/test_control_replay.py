"""Replay of runs whose answers were computed by formulas written out in the tests' support."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control.replaying.comparison import NOT_RECORDED, replay
from flexarm_core.errors import SettingError
from support.controlled_loop import (
    PERIOD_NS,
    ControlledRun,
    faded,
    outputs,
    pd_answer,
    pd_parameters,
    pd_run,
)

if TYPE_CHECKING:
    from flexarm_control.replaying.comparison import LoopRecord, Replay

SAMPLES = 100
# The formulas here may be rounded otherwise where they are not written as the law has them.
CLOSE_V = 1e-12
PI_PARAMETERS = {"law": "pi", "reference": "topic", "pi.kp": 0.4, "pi.ki": 0.5}


def places(found: Replay) -> list[int]:
    """Return the numbers of the samples whose commands differ."""
    return [difference.place.sequence for difference in found.differences]


def with_answer(record: LoopRecord, row: int, part: int, value_v: float) -> LoopRecord:
    """Return a record with another number in one command."""
    answers = record.answers.copy()
    answers[row, part] = value_v
    return replace(record, answers=answers)


def test_replay___of_the_recorded_law___is_equal_to_the_bit() -> None:
    found = replay(pd_run(SAMPLES).record(SAMPLES))

    assert (found.samples, found.commands, found.compared) == (SAMPLES, SAMPLES, SAMPLES)
    assert (found.laws, found.changes, found.differences) == (("pd",), (), ())
    assert found.largest_v == 0.0


def test_replay___gain_that_was_changed_and_not_recorded___is_named_at_its_first_sample() -> None:
    run = pd_run(40)
    for k in range(40, SAMPLES):
        run.answer(k, pd_answer(outputs(k), 0.5, 1.01))

    found = replay(run.record(SAMPLES))

    assert places(found) == list(range(41, SAMPLES + 1))
    first = found.differences[0]
    assert (first.place.command_sequence, first.change) == (41, None)
    assert first.place.time_s == pytest.approx(40 * PERIOD_NS * 1e-9)
    assert first.recorded == pytest.approx(pd_answer(outputs(40), 0.5, 1.01))
    assert first.recomputed == pytest.approx(pd_answer(outputs(40), 0.5, 1.0))
    expected_v = max(0.01 * abs(0.5 - outputs(k)[0]) for k in range(40, SAMPLES))
    assert found.largest_v == pytest.approx(expected_v)


def test_replay___gain_that_was_changed_and_reported___is_honoured_with_its_fade() -> None:
    run = pd_run(40)
    last = sum(pd_answer(outputs(39), 0.5, 1.0))
    run.report(40, pd_parameters(2.5), reference_v=0.5, handover=(last, 0.0, 1.0))
    own = np.array([pd_answer(outputs(k), 0.5, 2.5) for k in range(40, SAMPLES)])
    efforts_v = faded(own.sum(axis=1), last) - own[:, 1]
    for k, answer in zip(range(40, SAMPLES), zip(efforts_v, own[:, 1], strict=True), strict=True):
        run.answer(k, answer)

    found = replay(run.record(SAMPLES), tolerance_v=CLOSE_V)

    assert (found.compared, found.differences) == (SAMPLES, ())
    (change,) = found.changes
    assert (change.place.sequence, change.text) == (41, "pd.kp 1 to 2.5")


def test_replay___difference_after_a_change___names_the_change() -> None:
    run = pd_run(40)
    run.report(40, pd_parameters(1.0, **{"pd.compensation_v": 0.8}), reference_v=0.5)
    for k in range(40, 60):
        run.answer(k, pd_answer(outputs(k), 0.5, 1.0))
    run.report(60, pd_parameters(2.0), reference_v=0.5)
    for k in range(60, SAMPLES):
        run.answer(k, pd_answer(outputs(k), 0.5, 3.0 if k == 70 else 2.0))

    found = replay(run.record(SAMPLES))

    assert places(found) == [71]
    change = found.differences[0].change
    assert change is not None
    assert (change.place.sequence, change.text) == (61, "pd.kp 1 to 2")


def test_replay___set_point_that_was_reported___is_honoured_from_its_sample_on() -> None:
    run = pd_run(30)
    run.report(30, pd_parameters(1.0), reference_v=-1.0)
    for k in range(30, SAMPLES):
        run.answer(k, pd_answer(outputs(k), -1.0, 1.0))

    found = replay(run.record(SAMPLES))

    assert (found.compared, found.differences, found.changes) == (SAMPLES, (), ())


def test_replay___built_in_reference___begins_with_the_run_of_the_law() -> None:
    profile: dict[str, float | str] = {
        "reference": "square",
        "square.amplitude_v": 2.0,
        "square.period_s": 0.2,
    }
    run = ControlledRun()
    run.report(10, pd_parameters(1.0, **profile))
    for k in range(10, SAMPLES):
        reference_v = 2.0 if (k * PERIOD_NS * 1e-9) % 0.2 < 0.1 else -2.0
        run.answer(k, pd_answer(outputs(k), reference_v, 1.0))

    found = replay(run.record(SAMPLES))

    assert (found.compared, found.differences) == (SAMPLES - 10, ())


def pi_run(answered: list[int], reported: list[int]) -> ControlledRun:
    """Return a run of the PI law (4-1) at 300 Hz to 0.5 V that tells its sum at some samples."""
    run, sum_v, last_v = ControlledRun(), 0.0, 0.0
    for k in answered:
        if k in reported:
            fade = (last_v, 0.0, 0.0)
            run.report(k, PI_PARAMETERS, reference_v=0.5, handover=fade, integral_v_s=[sum_v])
        error_v = 0.5 - outputs(k)[0]
        sum_v += error_v / 300.0
        last_v = 0.4 * error_v + 0.5 * sum_v
        run.answer(k, (last_v, 0.0))
    return run


def test_replay___record_that_begins_in_mid_run___goes_on_from_the_memory() -> None:
    record = pi_run(list(range(SAMPLES)), reported=[0, 50]).record(SAMPLES)
    late = replace(
        record,
        sequence=record.sequence[20:],
        stamps_ns=record.stamps_ns[20:],
        volts=record.volts[20:],
        command_sequence=record.command_sequence[20:],
        answered=record.answered[20:] - 20,
        answers=record.answers[20:],
    )

    found = replay(late, tolerance_v=CLOSE_V)

    assert (found.commands, found.compared, found.differences) == (80, 50, ())


def test_replay___unanswered_samples___are_no_step_of_the_law() -> None:
    answered = [k for k in range(SAMPLES) if k % 7]
    record = pi_run(answered, reported=[1]).record(SAMPLES)

    found = replay(record, tolerance_v=CLOSE_V)

    assert (found.compared, found.differences) == (len(answered), ())


@pytest.mark.parametrize("lost", ["sample", "command"])
def test_replay___lost_message___goes_on_at_the_next_law_that_was_reported(lost: str) -> None:
    record = pi_run(list(range(SAMPLES)), reported=[0, 60]).record(SAMPLES)
    if lost == "sample":
        answered = record.answered.copy()
        answered[30] = NOT_RECORDED
        record = replace(record, answered=answered)
    else:
        kept = np.arange(SAMPLES) != 30
        record = replace(
            record,
            command_sequence=record.command_sequence[kept],
            answered=record.answered[kept],
            answers=record.answers[kept],
        )

    found = replay(record, tolerance_v=CLOSE_V)

    assert (found.compared, found.differences) == (30 + 40, ())


def test_replay___last_bit_of_one_command___is_a_difference_without_a_tolerance_only() -> None:
    record = pd_run(SAMPLES).record(SAMPLES)
    effort_v = float(record.answers[42, 0])
    record = with_answer(record, 42, 0, float(np.nextafter(effort_v, 9.0)))

    exact, tolerant = replay(record), replay(record, tolerance_v=CLOSE_V)

    assert (places(exact), places(tolerant)) == ([43], [])
    assert exact.largest_v == tolerant.largest_v == np.spacing(abs(effort_v))


@pytest.mark.parametrize("value_v", [float("nan"), float("inf")])
def test_replay___command_that_is_no_number___differs_at_any_tolerance(value_v: float) -> None:
    record = with_answer(pd_run(SAMPLES).record(SAMPLES), 5, 1, value_v)

    found = replay(record, tolerance_v=20.0)

    assert (places(found), found.largest_v) == ([6], float("inf"))


def test_replay___memory_of_another_version___is_refused() -> None:
    run = ControlledRun()
    run.report(0, PI_PARAMETERS)
    run.answer(0, (0.0, 0.0))

    with pytest.raises(SettingError, match="memory of law pi is that of another version"):
        replay(run.record(1))
