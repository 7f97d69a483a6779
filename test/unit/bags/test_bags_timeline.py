from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_bags.check import check_bag
from flexarm_bags.content import clock_problems, number_problems, restarts
from support.bag_samples import (
    START_NS,
    STEP_NS,
    Sent,
    arm_state,
    controlled_run,
    motor_command,
    write_bag,
)

if TYPE_CHECKING:
    from pathlib import Path

SAMPLES = 200


def problems(bag: Path) -> tuple[str, ...]:
    return check_bag(bag).problems


def test_check___missing_samples___are_counted(tmp_path: Path) -> None:
    messages = [m for k, m in enumerate(controlled_run(30)) if k not in {10, 11, 13, 20}]
    found = problems(write_bag(tmp_path / "run", messages))
    (samples,) = [line for line in found if line.startswith("/flexarm/state: ")]
    (commands,) = [line for line in found if line.startswith("/flexarm/command: ")]
    assert " periods without a sample at " in samples
    assert " commands missing at " in commands


@pytest.mark.parametrize(
    ("numbers", "line"),
    [
        ((1, 2, 2, 3), "the numbering does not go up at 1 place, the first after number 2"),
        ((5, 6, 2, 3), "the numbering does not go up at 1 place, the first after number 6"),
        ((1, 1, 2, 3), "the numbering does not go up at 1 place, the first after number 1"),
        ((1, 2, 6, 9), "5 periods without a sample at 2 places, the first after number 2"),
    ],
)
def test_check___numbers___say_what_is_wrong(
    tmp_path: Path, numbers: tuple[int, ...], line: str
) -> None:
    messages = [arm_state(number, START_NS + k * STEP_NS) for k, number in enumerate(numbers)]
    (found,) = problems(write_bag(tmp_path / "run", messages))
    assert found.startswith(f"/flexarm/state: {line}")


def run_of(numbers: range, start_ns: int, step_ns: int = STEP_NS) -> list[Sent]:
    return [arm_state(number, start_ns + k * step_ns) for k, number in enumerate(numbers)]


def test_check___sampling_started_again_at_another_rate___is_a_note(tmp_path: Path) -> None:
    messages = [
        *run_of(range(20, 60), START_NS, 3_333_333),
        *run_of(range(1, 101), START_NS + 10**9),
        *run_of(range(1, 51), START_NS + 3 * 10**9, 1_000_000),
    ]
    found = check_bag(write_bag(tmp_path / "run", messages))
    assert found.problems == ()
    assert "/flexarm/state: sampling was started again 2 times, the first after sample 59" in (
        found.notes
    )


def test_check___commands_started_again___are_a_note(tmp_path: Path) -> None:
    messages = [
        motor_command(number, START_NS + k * STEP_NS, 0.0)
        for k, number in enumerate((4, 5, 1, 2, 3))
    ]
    found = check_bag(write_bag(tmp_path / "run", messages))
    assert found.problems == ()
    assert "/flexarm/command: control was started again after command 5" in found.notes


def test_check___damage_in_a_run_of_several___is_found_there(tmp_path: Path) -> None:
    second = run_of(range(1, 101), START_NS + 10**9)
    late = [
        arm_state(number, START_NS + 2 * 10**9 + (number + 2 * (number > 30)) * STEP_NS)
        for number in range(1, 61)
    ]
    del second[40:43]
    messages = [*run_of(range(1, 51), START_NS), *second, *late]
    assert problems(write_bag(tmp_path / "run", messages)) == (
        "/flexarm/state, run 2: 3 periods without a sample at 1 place, the first after number 40",
        (
            "/flexarm/state, run 3: 2 periods of 2.000 ms without a sample at 1 place,"
            " the first after number 30"
        ),
    )


@pytest.mark.parametrize(
    ("numbers", "sent", "found"),
    [
        ((1, 2, 1, 2, 3, 1), (0, 1, 2, 3, 4, 5), [2, 5]),
        ((5, 6, 2, 3), (0, 1, 2, 3), []),
        ((1, 1, 2), (0, 1, 2), []),
        ((8, 9, 1, 2), (5, 6, 6, 7), []),
        ((8, 9, 1, 2), (5, 6, 4, 5), []),
        ((7,), (0,), []),
    ],
)
def test_restarts___are_where_one_follows_and_time_goes_on(
    numbers: tuple[int, ...], sent: tuple[int, ...], found: list[int]
) -> None:
    assert restarts(np.array(numbers), np.array(sent)).tolist() == found


def timed(stamp_ms: list[float], sent_ms: list[float] | None = None) -> list[str]:
    stamps_ns = np.array([round(ms * 1e6) for ms in stamp_ms])
    sent_ns = stamps_ns if sent_ms is None else np.array([round(ms * 1e6) for ms in sent_ms])
    return clock_problems(np.arange(1, len(stamps_ns) + 1), stamps_ns, sent_ns)


EVEN_MS = [2.0 * k for k in range(20)]


def test_clock___even_samples___have_no_problem() -> None:
    assert timed(EVEN_MS) == []


def test_clock___late_sample_that_is_made_up_for___has_no_problem() -> None:
    assert timed([*EVEN_MS[:7], EVEN_MS[7] + 1.5, *EVEN_MS[8:]]) == []


def test_clock___periods_left_out___are_counted() -> None:
    assert timed([*EVEN_MS[:7], *EVEN_MS[9:]]) == [
        "2 periods of 2.000 ms without a sample at 1 place, the first after number 7"
    ]


def test_clock___two_long_steps_in_a_row___are_counted_once() -> None:
    # After number 7 come 2 periods without a sample, after number 8 another 3.
    assert timed([*EVEN_MS[:7], EVEN_MS[9], *EVEN_MS[13:]]) == [
        "5 periods of 2.000 ms without a sample at 2 places, the first after number 7"
    ]


@pytest.mark.parametrize("late", [0.0, 0.4, 0.9])
def test_clock___late_sample_after_periods_left_out___counts_only_whole_ones(late: float) -> None:
    stamps_ms = [*EVEN_MS[:7], EVEN_MS[9] + 2.0 * late, *EVEN_MS[10:], *(40.0, 42.0, 44.0)]
    assert timed(stamps_ms) == [
        "2 periods of 2.000 ms without a sample at 1 place, the first after number 7"
    ]


def test_clock___last_sample_late___is_not_a_period_left_out() -> None:
    assert timed([*EVEN_MS[:-1], EVEN_MS[-1] + 1.2]) == []


def test_clock___numbers_that_say_what_was_left_out___are_not_counted_again() -> None:
    numbers = np.array([1, 2, 3, 4, 5, 6, 9, 10, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23])
    # Two of the samples are late as well, one of them next to a gap.
    late = np.isin(numbers, (9, 17)) * 0.8
    stamps_ns = np.rint((numbers + late) * 2e6).astype(np.int64)
    assert clock_problems(numbers, stamps_ns, stamps_ns) == []
    assert number_problems(numbers, "flexarm_msgs/msg/ArmState") == [
        "5 periods without a sample at 2 places, the first after number 6"
    ]


@pytest.mark.parametrize("seed", range(20))
def test_clock___stalls_late_samples_and_jitter___every_period_left_out_is_counted(
    seed: int,
) -> None:
    """A sampler that skips whole periods when it is late, as a busy machine makes it."""
    random = np.random.default_rng(seed)
    deadlines, deadline = [], 0
    late = []
    for _ in range(4000):
        stalls = random.random() < 0.02
        late_by = random.exponential(6.0) if stalls else abs(random.normal(0.0, 0.05))
        deadline += int(late_by)
        deadlines.append(deadline)
        late.append(late_by % 1.0)
        deadline += 1
    # The record ends on time.
    deadlines += [deadline + k for k in range(10)]
    late += [0.0] * 10
    numbers = np.arange(1, len(deadlines) + 1)
    left_out = deadlines[-1] - deadlines[0] - (len(deadlines) - 1)
    # The quartz of the machine is off by 50 ppm.
    stamps_ns = np.rint((np.array(deadlines) + late) * 2e6 * (1 + 5e-5)).astype(np.int64)

    (line,) = clock_problems(numbers, stamps_ns, stamps_ns)

    assert re.match(rf"{left_out} periods of [12]\.\d+ ms without a sample at ", line), line


def test_clock___stamps_that_stand_or_go_back___are_named() -> None:
    (standing,) = timed([*EVEN_MS[:5], EVEN_MS[4], *EVEN_MS[6:]], EVEN_MS)
    assert standing == "the stamps do not advance at 1 place, the first after number 5"
    assert timed([*EVEN_MS[:5], 0.5, *EVEN_MS[6:]])[0].startswith("the stamps do not advance")


def test_clock___wall_clock_set_while_recording___is_named() -> None:
    stamps_ms = [ms + 0.01 * (k % 3) for k, ms in enumerate(EVEN_MS)]
    ahead = [ms + 5000.0 * (k >= 12) for k, ms in enumerate(stamps_ms)]
    assert timed(stamps_ms, ahead) == ["the clock was set by +5.000 s after number 12"]
    back = [5000.0 + ms - 5000.0 * (k >= 12) for k, ms in enumerate(EVEN_MS)]
    assert timed(EVEN_MS, back) == [
        "the clock does not advance at 1 place, the first after number 12",
        "the clock was set by -5.000 s after number 12",
    ]


@pytest.mark.parametrize("pace", [0.05, 1.0])
def test_clock___virtual_time_that_pauses___has_no_problem(pace: float) -> None:
    sent_ms = [pace * ms + 3000.0 * (k >= 12) for k, ms in enumerate(EVEN_MS)]
    assert timed(EVEN_MS, sent_ms) == []
