"""Garbage collector of a process with a loop: it rests meanwhile, and what is left over goes."""

from __future__ import annotations

import gc
import weakref

import pytest

from flexarm_node import collector


class Cycle:
    """Object that only a collector can free."""

    def __init__(self) -> None:
        self.itself = self


def left_over() -> weakref.ref[Cycle]:
    return weakref.ref(Cycle())


@pytest.fixture(autouse=True)
def _as_before() -> None:
    assert gc.isenabled()


def test_resting___two_loops___to_the_end_of_the_second() -> None:
    # Python 3.12 counts some objects of its own.
    frozen = gc.get_freeze_count()
    with collector.resting():
        with collector.resting():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() <= frozen


def test_resting___error_in_the_loop___ends_it() -> None:
    with pytest.raises(ValueError, match="broken"), collector.resting():
        raise ValueError("broken")
    assert gc.isenabled()


def test_collect_youngest___cycles_of_every_sample___are_freed_while_the_collector_rests() -> None:
    with collector.resting():
        left = [left_over() for _ in range(10)]
        for _ in range(5_000):
            left.append(left_over())
            collector.collect_youngest()
        alive = sum(each() is not None for each in left)
    assert alive < 1_000


def test_collect_youngest___few_objects___are_left_for_later() -> None:
    with collector.resting():
        gc.collect(0)
        left = left_over()
        collector.collect_youngest()
        assert left() is not None


@pytest.mark.slow
def test_collect_youngest___library_that_was_loaded___is_looked_at_after_the_loop() -> None:
    with collector.resting():
        made = [[each] for each in range(100_000)]
        left = left_over()
        before = gc.get_freeze_count()
        collector.collect_youngest()
        assert gc.get_freeze_count() - before > len(made)
        assert left() is not None
    gc.collect()
    assert left() is None
