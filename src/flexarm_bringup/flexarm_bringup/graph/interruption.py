"""Ctrl-C, whatever the code that it interrupts makes of it."""

from __future__ import annotations

import signal
from contextlib import contextmanager
from typing import TYPE_CHECKING

from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def interruptible() -> Iterator[None]:
    """Leave the block by a KeyboardInterrupt at SIGINT or SIGTERM.

    A binding in C++ that calls Python may report one as an error of its own, such as "Unable to
    convert call argument". What a node did wrong, a `LaunchError`, is told all the same.
    """
    stopped = False

    def interrupt(*_: object) -> None:
        nonlocal stopped
        stopped = True
        raise KeyboardInterrupt

    for stop in (signal.SIGINT, signal.SIGTERM):  # also where a shell has SIGINT ignored
        signal.signal(stop, interrupt)
    try:
        yield
    except LaunchError:
        raise
    except Exception as error:
        if stopped:
            raise KeyboardInterrupt from error
        raise
