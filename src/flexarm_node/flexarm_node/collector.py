"""Garbage collector of a process with a loop: it rests while a loop runs.

A collection stops every thread of the interpreter: for a tenth of a second where it looks at all
that a law and its libraries have made. That is often due just after the start of a loop. What lives
then lives to the loop's end. Of the rest only the youngest objects are looked at, once a second.
"""

from __future__ import annotations

import gc
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

# A service call leaves some ten objects, a law that is loaded a hundred thousand.
_MANY = 2000
_turn = threading.Lock()
_loops = 0


@contextmanager
def resting() -> Iterator[None]:
    """Let the collector rest; several loops of one process may ask for it at a time."""
    global _loops  # noqa: PLW0603 - the interpreter has one collector
    with _turn:
        _loops += 1
        gc.disable()
        # What the next `collect_youngest` would look at.
        gc.freeze()
    try:
        yield
    finally:
        with _turn:
            _loops -= 1
            if not _loops:
                gc.unfreeze()
                gc.enable()


def collect_youngest() -> None:
    """Collect what was made since the last call, such as the leavings of calls from other nodes.

    A whole library that was loaded is left alone to the end of the loop.
    """
    if gc.get_count()[0] > _MANY:
        gc.freeze()
    else:
        gc.collect(0)
