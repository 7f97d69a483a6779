from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident.reading.grid import Grid, Run, longest_run, notices, place
from flexarm_ident.records.data_warning import Grade

PERIOD_NS = 3_333_333


def grid(sequence: list[int]) -> Grid:
    numbers = np.array(sequence)
    return place(numbers, (numbers - numbers[0]) * PERIOD_NS)


def test_longest_run___restarts___is_where_the_numbers_go_up_longest() -> None:
    run = longest_run(np.array([4, 5, 9, 1, 2, 3, 7, 8, 1]))
    assert (run.messages, run.restarts) == (slice(3, 8), 2)


def test_notices___even_record___says_nothing() -> None:
    assert notices(Run(slice(0, 45), 0), grid(list(range(5, 50))), 45) == ()


def test_notices___restarts___say_which_messages_are_used() -> None:
    (found,) = notices(Run(slice(3, 48), 2), grid(list(range(5, 50))), 60)
    assert found.code == "partial_record"
    assert found.figures == {"places": 2.0, "first": 3.0, "last": 47.0, "messages": 60.0}
    assert "used messages 3 to 47 of 60" in found.text


def test_notices___short_and_long_holes___are_distinguished() -> None:
    sequence = [k for k in range(100) if k not in {10, 11, 40, *range(60, 67)}]
    (found,) = notices(Run(slice(0, 90), 0), grid(sequence), 90)
    assert found.code == "lost_samples"
    assert found.figures == {
        "lost": 10.0,
        "missing": 10.0,
        "rows": 100.0,
        "holes": 3.0,
        "longest": 7.0,
        "left_out": 7.0,
    }
    assert "1 longer hole of 7 samples" in found.text
    assert found.grade == Grade.CAUTION


def test_notices___holes_that_are_filled___are_no_defect_to_fix() -> None:
    sequence = [k for k in range(200) if k % 20 not in {3, 4, 5}]
    (found,) = notices(Run(slice(0, 170), 0), grid(sequence), 170)
    assert (found.code, found.figures["missing"]) == ("lost_samples", 30.0)
    assert found.grade == Grade.INFORMATION


def test_notices___lost_and_badly_timed_samples___are_counted_apart() -> None:
    numbers = np.array([k for k in range(300) if k != 250])
    stamps_ns = numbers * PERIOD_NS
    for late in (100, 150, 200):
        stamps_ns[late] += round(0.8 * PERIOD_NS)
    (lost,) = notices(Run(slice(0, 299), 0), place(numbers, stamps_ns), 299)
    assert (lost.figures["lost"], lost.figures["missing"]) == (1.0, 4.0)
    assert lost.text.startswith(
        "1 of 300 periods is without a sample and 3 samples came too late for their instants, in 4 "
    )


def test_notices___late_samples_alone___are_not_called_lost() -> None:
    stamps_ns = np.arange(300) * PERIOD_NS
    # The last one too: the record is not a period longer for it.
    stamps_ns[[150, 299]] += round(0.6 * PERIOD_NS)
    found = place(np.arange(300), stamps_ns)
    assert found.lost == 0
    holes, _ = notices(Run(slice(0, 300), 0), found, 300)
    assert holes.text.startswith("2 samples came too late for their instants, in 2 holes")


def test_notices___jittering_clock___is_named_with_its_deviation() -> None:
    off_s = np.random.default_rng(1).normal(0.0, 4e-4, 3000)
    stamps_ns = np.arange(3000) * PERIOD_NS + np.rint(off_s * 1e9).astype(np.int64)
    (found,) = notices(Run(slice(0, 3000), 0), place(np.arange(3000), stamps_ns), 3000)
    assert found.code == "sampling"
    # What is nearly on time passes for on time.
    counted = np.where(np.abs(off_s) > 0.1 / 300.0, off_s, 0.0)
    assert found.figures["deviation_s"] == pytest.approx(np.sqrt(np.mean(counted**2)), rel=0.05)
    assert found.figures["row"] == np.argmax(np.abs(off_s))
    assert found.figures["period_s"] == pytest.approx(1.0 / 300.0, rel=1e-9)


def test_notices___one_late_sample___is_named_with_its_row() -> None:
    stamps_ns = np.arange(3000) * PERIOD_NS
    stamps_ns[1000] += PERIOD_NS * 2 // 5
    (found,) = notices(Run(slice(0, 3000), 0), place(np.arange(3000), stamps_ns), 3000)
    assert (found.figures["late"], found.figures["row"]) == (1.0, 1000.0)
    assert "1 of 3000 samples were taken more than 0.3 periods off" in found.text
