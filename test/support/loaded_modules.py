"""Modules that an import brings with it."""

from __future__ import annotations

import subprocess
import sys


def loaded(imported: str, names: str) -> list[str]:
    """Return those of some modules, apart by spaces, that a fresh Python has after an import."""
    program = f"import sys, {imported}; print(*sys.modules.keys() & {names.split()})"
    command = [sys.executable, "-c", program]
    run = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - ours
    return run.stdout.split()
