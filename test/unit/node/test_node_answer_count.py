from __future__ import annotations

import pytest

from flexarm_node.statistics import AnswerCount

MS = 1_000_000


def test_commands___count_from_one_until_the_restart() -> None:
    count = AnswerCount()
    assert [count.next() for _ in range(3)] == [1, 2, 3]
    count.restart()
    assert count.next() == 1
    assert count.answered == 4


def test_samples___left_out___are_counted() -> None:
    count = AnswerCount()
    for sequence in (4, 5, 8):
        count.begins(sequence, sequence * MS)
    assert count.skipped == 2
    assert count.run_start_ns == 4 * MS


def test_number_that_goes_back___begins_a_run() -> None:
    count = AnswerCount()
    assert [count.begins(1, 10 * MS), count.begins(500, 20 * MS)] == [True, False]
    assert count.begins(1, 30 * MS)
    assert count.run_start_ns == 30 * MS
    assert count.skipped == 498


def test_sample___that_comes_twice_or_behind_a_newer_one___is_not_new() -> None:
    count = AnswerCount()
    for sequence in (1, 2, 3, 5):
        assert count.is_new(sequence, sequence * MS)
        count.begins(sequence, sequence * MS)
    assert not any(count.is_new(sequence, sequence * MS) for sequence in (5, 4, 1))
    assert count.is_new(6, 6 * MS)


def test_first_sample___behind_the_second___is_not_new() -> None:
    count = AnswerCount()
    assert count.begins(2, 2 * MS)
    assert not count.is_new(1, 1 * MS)


def test_run_after_a_short_one___on_a_clock_that_was_set_back___is_new() -> None:
    count = AnswerCount()
    count.begins(5, 9000 * MS)
    assert count.is_new(1, 9003 * MS)
    assert count.is_new(1, 7000 * MS)


@pytest.mark.parametrize(("sequence", "stamp_ms"), [(1, 30), (1, 2), (3, 5001), (1, -4000)])
def test_first_sample_of_another_run___is_new_whatever_the_clock(
    sequence: int, stamp_ms: int
) -> None:
    count = AnswerCount()
    for taken in (1, 2, 200):
        count.begins(taken, (9 + taken) * MS)
    assert count.is_new(sequence, stamp_ms * MS)


def test_restart___the_next_sample_begins_a_run() -> None:
    count = AnswerCount()
    count.begins(7, 10 * MS)
    count.restart()
    assert count.begins(8, 20 * MS)
