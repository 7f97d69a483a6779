"""First word of a verb: nobody waits longer than a second for a sign of life.

A busy machine takes seconds to load the libraries of a verb. Until the verb itself has said
something, one line on the standard error says that it is at work. Nothing heavy is imported here.
"""

from __future__ import annotations

import io
import os
import sys
import threading

_PATIENCE_S = 0.6
_NOT_OURS = frozenset({"exec", "ros2", "run", "completion"})
"""Verbs that hand on to a program of the user, or write for a shell."""


class _Heard(io.TextIOWrapper):
    """Standard stream that notes its first text."""

    waiting: threading.Timer

    def write(self, text: str) -> int:
        self.waiting.cancel()
        return super().write(text)


def promise_word(arguments: list[str]) -> None:
    """Have a word said soon, unless the program has said something by then."""
    verb = next((each for each in arguments if not each.startswith("-")), "")
    # The script that starts Python has said it on a machine that is very busy.
    has_said = os.environ.pop("FLEXARM_SAID", "")
    if not verb or verb in _NOT_OURS or has_said or "_FLEXARM_COMPLETE" in os.environ:
        return
    waiting = threading.Timer(_PATIENCE_S, say_word, (verb,))
    waiting.daemon = True
    for name in ("stdout", "stderr"):
        setattr(sys, name, _heard(getattr(sys, name), waiting))
    waiting.start()


def say_word(verb: str) -> None:
    """Say that a verb is at work."""
    # Past the stream that listens: it may be in use by the thread that is at work.
    os.write(2, f"flexarm {verb}: at work\n".encode())


def _heard(stream: io.TextIOWrapper, waiting: threading.Timer) -> io.TextIOWrapper:
    settings = {
        "encoding": stream.encoding,
        "errors": stream.errors,
        "line_buffering": stream.line_buffering,
        "write_through": stream.write_through,
    }
    heard = _Heard(stream.detach(), **settings)  # type: ignore[arg-type]
    heard.waiting = waiting
    return heard
