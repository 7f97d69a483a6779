"""Interruption by a signal, raised and remembered."""

from __future__ import annotations

import signal
import threading
from contextlib import suppress

import pytest

from flexarm_bringup.console import terminal
from flexarm_bringup.console.interruption import (
    check_interruption,
    held_back,
    interruptible,
    is_interrupted,
)


def test_signal___interrupts_the_block___and_the_handler_before_is_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), interruptible(signal.SIGTERM):
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


def test_signal___swallowed_by_a_library___interrupts_at_the_next_step() -> None:
    with interruptible(signal.SIGTERM), terminal.progress() as show:
        show("before", 0.0)
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            show("after", 0.5)


def test_no_signal___nothing_is_raised___also_after_an_earlier_one() -> None:
    with suppress(KeyboardInterrupt), interruptible(signal.SIGTERM):
        signal.raise_signal(signal.SIGTERM)
    assert not is_interrupted()
    check_interruption()


def test_signal___in_a_block_within_another___is_remembered_until_the_outer_one_ends() -> None:
    with interruptible(signal.SIGTERM):
        with suppress(KeyboardInterrupt), interruptible(signal.SIGTERM, signal.SIGINT):
            signal.raise_signal(signal.SIGTERM)
        assert is_interrupted()
        with interruptible(signal.SIGTERM):
            assert is_interrupted()
    assert not is_interrupted()


def test_signals___held_back___interrupt_once_the_block_is_done() -> None:
    done = []

    def work() -> None:
        with held_back(signal.SIGINT, signal.SIGTERM):
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGINT)
            done.append("work")

    with interruptible(signal.SIGINT, signal.SIGTERM):
        handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            work()
        assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers
        with held_back(signal.SIGINT):
            done.append("more")
    assert done == ["work", "more"]


def test_other_thread___leaves_the_signals_alone() -> None:
    before = signal.getsignal(signal.SIGTERM)
    found = []

    def work() -> None:
        with interruptible(signal.SIGTERM):
            found.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [before]
