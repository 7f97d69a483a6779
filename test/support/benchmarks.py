"""Runs of a benchmark in a process of its own, as `flexarm bench` starts it."""

from __future__ import annotations

import os
import subprocess
import sys


def run_bench(module: str, *options: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a module of the folder `bench`, named like `ident.reduction`."""
    return subprocess.run(  # noqa: S603 - our own benchmark
        [sys.executable, "-m", f"bench.{module}", *options],
        capture_output=True,
        text=True,
        check=False,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "OMP_NUM_THREADS": "1",
            "COLUMNS": "120",
            **environment,
        },
    )
