from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from flexarm_core.signals import Command
from flexarm_daq.loop.acquisition import LockStep
from flexarm_daq.loop.complaints import Complaints
from support.acquisition_bench import RATE_HZ, WIDE, Bench, at_once, never, reply

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_daq.loop.exchange import Record
    from support.acquisition_bench import Clock

    Answer = Callable[[Record], Sequence[tuple[float, Command]]]

SAMPLES = round(2.0 * RATE_HZ)


def run(clock: Clock, answer: Answer) -> Bench:
    """Return a run of two seconds in real time."""
    return Bench(clock, answer, virtual=False, samples=SAMPLES, limits=WIDE).run()


def complaint(clock: Clock, answer: Answer) -> str:
    """Return the complaint about such a run."""
    return Complaints(RATE_HZ).look(run(clock, answer).acquisition)


def test_loop_that_is_well___has_none(clock: Clock) -> None:
    assert complaint(clock, at_once(lambda _: 1.0)) == ""
    # Nobody has commanded yet.
    assert complaint(clock, never) == ""


def test_commands_that_are_no_numbers___are_reported(clock: Clock) -> None:
    reported = complaint(clock, at_once(lambda record: math.nan if record.sequence == 50 else 1.0))
    assert reported == "commands come that are not finite numbers: the drive is at zero for each"


@pytest.mark.parametrize("effort_v", [20.0, -1e9])
def test_commands_that_are_all_limited___are_reported_with_the_limit(
    clock: Clock, effort_v: float
) -> None:
    assert complaint(clock, at_once(lambda _: effort_v)) == (
        "every command is limited, by magnitude: the commander asks for more than is allowed"
    )
    mostly = at_once(lambda record: 1.0 if record.sequence % 10 == 0 else effort_v)
    assert complaint(clock, mostly) == ""


def test_commander_that_ends___is_reported(clock: Clock) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(0.0, reply(record, 1.0))] if record.sequence <= 20 else []

    assert complaint(clock, answer) == (
        "no command in time since the one for sample 20: the drive is at zero"
    )


def test_commander_that_does_not_count___is_reported(clock: Clock) -> None:
    reported = complaint(clock, lambda record: [(0.0, Command(7, record.sequence, (1.0,), (0.0,)))])
    assert reported.startswith(
        "commands come and none is obeyed: their numbers (sequence) do not grow"
    )


def test_complaints___are_of_the_time_since_the_last_look(clock: Clock) -> None:
    bench = run(clock, at_once(lambda record: math.nan if record.sequence == 50 else 1.0))
    complaints = Complaints(RATE_HZ)
    assert "not finite numbers" in complaints.look(bench.acquisition)
    assert complaints.look(bench.acquisition) == ""


def test_sample_that_waits_for_its_answer___is_reported_while_it_does(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answer(record: Record) -> list[tuple[float, Command]]:
        return [(2.5 if record.sequence == 9 else 0.0, reply(record, 1.0))]

    patient = LockStep(0.0, 5.0, is_answered=True)
    bench = Bench(clock, answer, virtual=True, samples=12, lockstep=patient)
    complaints, looks = Complaints(RATE_HZ), []
    monkeypatch.setattr(
        bench.link, "spare_time", lambda: looks.append(complaints.look(bench.acquisition))
    )
    bench.run()

    waits = "the arm's time stands: sample 9 waits for its answer"
    assert set(looks) == {"", waits}
    # It has waited for one second of two and a half before it is told.
    assert looks.count(waits) > 20
    assert looks[0] == looks[-1] == ""
