"""Benchmark of the command line: what a user waits for, from the call to the end of a verb.

Each verb is called as in a terminal, `./flexarm VERB`, in turns with the others and with a bare
Python that imports scipy.signal, which any identification needs. The least of several runs is what
the verb costs; the median is what a busy machine makes of it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

import click
from rich.console import Console
from rich.progress import track

from bench.tools import count_option, json_option, make_table, typed_environment, write_json
from flexarm_bringup.console import terminal

if TYPE_CHECKING:
    from collections.abc import Sequence

_ROOT = Path(__file__).parents[2]
_BAG = _ROOT / "bags" / "c_dat3_0g"
_BASELINE = "Python with scipy.signal"


class Run(NamedTuple):
    """What one call took: seconds by the clock, seconds of CPU, and megabytes at its peak."""

    wall_s: float
    cpu_s: float
    memory_mb: float


@click.command()
@count_option("--runs", 5)
@json_option
def main(runs: int, json_file: Path | None) -> None:
    """Measure, print a table, and write the figures to a file on request."""
    with tempfile.TemporaryDirectory(prefix="flexarm_bench_") as name:
        calls = _calls(Path(name))
        taken: dict[str, list[Run]] = {call: [] for call in calls}
        for turn in track(range(runs + 1), "turns", console=Console(stderr=True)):
            for call, command in calls.items():
                run = measured(command)
                if turn:  # the first one reads files from the disk and compiles modules
                    taken[call].append(run)
    base_s = median(run.wall_s for run in taken[_BASELINE])
    table = make_table("call", "least s", "median s", "ratio", "CPU s", "MB")
    figures = []
    for call, found in taken.items():
        walls = [run.wall_s for run in found]
        row = {
            "call": call,
            "least_s": min(walls),
            "median_s": median(walls),
            "ratio_to_baseline": median(walls) / base_s,
            "cpu_s": min(run.cpu_s for run in found),
            "memory_mb": max(run.memory_mb for run in found),
        }
        figures.append(row)
        table.add_row(
            call,
            f"{row['least_s']:.2f}",
            f"{row['median_s']:.2f}",
            f"{row['ratio_to_baseline']:.2f}",
            f"{row['cpu_s']:.2f}",
            f"{row['memory_mb']:.0f}",
        )
    terminal.show_table(table)
    terminal.CONSOLE.print(f"ratios are those of the medians, to {_BASELINE}")
    write_json(json_file, figures)


def _calls(folder: Path) -> dict[str, list[str]]:
    """Return the calls by their names, the baseline first."""
    flexarm = str(_ROOT / "flexarm")
    return {
        _BASELINE: [sys.executable, "-c", "import scipy.signal"],
        "--version": [flexarm, "--version"],
        "status --help": [flexarm, "status", "--help"],
        "catalogue": [flexarm, "catalogue"],
        "bag check, 40 s": [flexarm, "bag", "check", str(_BAG)],
        "identify, 40 s": [flexarm, "identify", str(_BAG), "-o", str(folder / "model")],
        "report, 40 s": [flexarm, "report", str(_BAG), "-o", str(folder / "report.html")],
    }


def measured(command: Sequence[str]) -> Run:
    """Run a command as from a terminal.

    Raises
    ------
    SystemExit
        If it fails: its last line says why.
    """
    begun_s = time.perf_counter()
    with tempfile.TemporaryFile() as output:
        child = subprocess.Popen(  # noqa: S603 - our own calls
            command, stdout=output, stderr=subprocess.STDOUT, env=typed_environment()
        )
        _, status, used = os.wait4(child.pid, 0)
        wall_s = time.perf_counter() - begun_s
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            output.seek(0)
            words = output.read().decode(errors="replace").strip().splitlines()
            raise SystemExit(f"{' '.join(command)}: {words[-1] if words else child.returncode}")
    return Run(wall_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)


if __name__ == "__main__":
    main()
