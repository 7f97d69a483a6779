"""Test that the package, and the job of its node, load nothing that takes long."""

import subprocess
import sys

_LOADED = """
import sys
import flexarm_ident, flexarm_ident.job
slow = "control matplotlib numba scipy.linalg scipy.optimize scipy.signal scipy.stats".split()
print(*(name for name in slow if name in sys.modules))
"""


def test_import__slow_libraries___wait_until_they_are_needed() -> None:
    command = [sys.executable, "-c", _LOADED]
    run = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - ours
    assert not run.stdout.split()
