"""Garbage collector of a process with a loop: it rests while a loop runs.

A collection stops every thread of the interpreter: for a tenth of a second where it looks at all
that a law and its libraries have made. That is often due just after the start of a loop. What lives
then lives to the loop's end. Of the rest only the youngest objects are looked at, a few hundred at
a time, between an answer and the next sample.
"""

from __future__ import annotations

import gc
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

# So many objects are looked at in less than a tenth of a millisecond.
_DUE = 500
# More come at once only while the loop's own thread is held up: a law that is loaded then has made
# a hundred thousand.
_MANY = 20_000
_turn = threading.Lock()
_loops = 0


@contextmanager
def resting() -> Iterator[None]:
    """Let the collector rest; several loops of one process may ask for it at a time."""
    global _loops  # noqa: PLW0603 - the interpreter has one collector
    with _turn:
        _loops += 1
        gc.disable()
        # What the first `collect_youngest` would look at.
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
    """Collect what was made since the last collection, when that is enough to be worth it.

    A whole library that was loaded meanwhile is left alone to the end of the loop.
    """
    made = gc.get_count()[0]
    if made > _MANY:
        gc.freeze()
    elif made > _DUE:
        gc.collect(0)
