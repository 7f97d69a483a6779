"""Start of the command: an interruption while its modules load ends it without a traceback."""

from __future__ import annotations

import signal
import sys

from flexarm_bringup.console.first_word import promise_word


def main() -> None:
    """Load the command and run it."""
    promise_word(sys.argv[1:])
    is_usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_usual:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from flexarm_bringup.cli import main as command  # noqa: PLC0415 - what takes a while

    if is_usual:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    command()
