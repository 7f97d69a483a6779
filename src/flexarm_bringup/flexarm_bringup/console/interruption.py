"""Interruption by a signal, also where a library swallows the KeyboardInterrupt.

A compiler or a binding that calls Python from C cannot hand an exception on: it prints it, and
goes on. The signal is therefore remembered, and long work asks for it between its steps.
"""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_stopped = threading.Event()


@contextmanager
def interruptible(*signals: signal.Signals) -> Iterator[None]:
    """Raise a KeyboardInterrupt at each of some signals, also where a shell has them ignored.

    A signal is remembered until the outermost block ends.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's
        return
    before = {each: signal.signal(each, _interrupt) for each in signals}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler or signal.SIG_DFL)
        if _interrupt not in before.values():
            _stopped.clear()


@contextmanager
def held_back(*signals: signal.Signals) -> Iterator[None]:
    """Let signals wait for the end of the block, in which an exception would lose what it makes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    come: list[int] = []
    before = {each: signal.signal(each, lambda number, _: come.append(number)) for each in signals}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler or signal.SIG_DFL)
        for number in come[:1]:
            signal.raise_signal(number)


def is_interrupted() -> bool:
    """Return whether a signal has come in the `interruptible` block that is running."""
    return _stopped.is_set()


def check_interruption() -> None:
    """Raise the KeyboardInterrupt of a signal that has come."""
    if is_interrupted():
        raise KeyboardInterrupt


def _interrupt(*_: object) -> None:
    _stopped.set()
    raise KeyboardInterrupt
