from __future__ import annotations

import signal
import subprocess
import sys

INTERRUPTED = """
import os, signal, sys
class Finder:
    def find_spec(self, name, *_):
        if name == "flexarm_bringup.cli":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
from flexarm_bringup.start import main
main()
"""
HANDLERS = """
import signal, sys
before = signal.{handler}
signal.signal(signal.SIGINT, before)
sys.argv = ["flexarm", "--version"]
from flexarm_bringup.start import main
try:
    main()
finally:
    assert signal.getsignal(signal.SIGINT) is before
"""


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603 - our own code
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )


def test_interruption___while_the_command_loads___ends_it_without_a_word() -> None:
    done = run(INTERRUPTED)
    assert done.returncode == -signal.SIGINT
    assert (done.stdout, done.stderr) == ("", "")


def test_start___keeps_the_handler_that_was_there() -> None:
    for handler in ("default_int_handler", "SIG_IGN"):
        done = run(HANDLERS.format(handler=handler))
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("flexarm, version ")
