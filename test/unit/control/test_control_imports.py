"""Test that a controller's process loads nothing that takes long."""

import subprocess
import sys

_LOADED = """
import sys
import flexarm_control.controller_node
slow = "control matplotlib numba scipy.optimize scipy.signal scipy.stats".split()
print(*(name for name in slow if name in sys.modules))
"""


def test_import_of_the_node__slow_libraries___wait_until_they_are_needed() -> None:
    command = [sys.executable, "-c", _LOADED]
    run = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - ours
    assert not run.stdout.split()
