"""Endurance of the recording: ten minutes at 500 Hz with a busy core, and every sample in the bag.

The simulated rig in real time with controller and recorder as processes, and beside them a process
that never rests. Every sample that was taken must be in the bag, else the exit code is 1.
Periods that a busy machine skipped are reported.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.tools import json_option, write_json
from flexarm_bags.check import check_bag
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.graph.processes import LaunchError
from flexarm_ident.reading.read import read_bag_report

if TYPE_CHECKING:
    from flexarm_bringup.graph.run_figures import Run


@click.command()
@click.option("--rate", "rate_hz", type=click.FloatRange(10.0, 2000.0), default=500.0)
@click.option("--minutes", type=click.FloatRange(0.05), default=10.0, show_default=True)
@click.option("--idle", is_flag=True, help="No busy process beside it.")
@json_option
def main(*, rate_hz: float, minutes: float, idle: bool, json_file: Path | None) -> None:
    """Record, check the bag, print what was lost, and write the figures to a file on request."""
    with tempfile.TemporaryDirectory(prefix="flexarm_endurance_") as name:
        bag = Path(name, "run")
        try:
            run = recorded(bag, rate_hz, 60.0 * minutes, busy=not idle)
        except LaunchError as error:
            raise click.ClickException(str(error)) from None
        reading, found = read_bag_report(bag), check_bag(bag)
    figures = {
        "rate_hz": rate_hz,
        "minutes": minutes,
        "sampled": run.taken,
        "recorded": reading.samples,
        "skipped": run.missed,
        "problems": list(found.problems),
    }
    terminal.CONSOLE.print(
        f"{run.taken} samples in {minutes:g} minutes at {rate_hz:g} Hz, {reading.samples} recorded,"
        f" {run.missed} periods skipped"
    )
    for problem in found.problems:
        terminal.CONSOLE.print(f"  {problem}")
    write_json(json_file, figures)
    sys.exit(reading.samples != run.taken)


def recorded(bag: Path, rate_hz: float, length_s: float, *, busy: bool) -> Run:
    """Record a run of the DAQ node, which ends by itself; return what it says of it."""
    samples = round(length_s * rate_hz)
    parameters: dict[str, dict[str, Any]] = {
        "daq": {"rate_hz": rate_hz, "time": "real"},
        "controller": {"law": "pdpc", "reference": "varying_square"},
        "recorder": {"bag": str(bag)},
    }
    burner = multiprocessing.get_context("spawn").Process(target=_burn, daemon=True)
    nodes = ("recorder", "controller", "daq")
    try:
        if busy:
            burner.start()
        log = bag.with_name("nodes.log")
        with running_graph(parameters, log, nodes=nodes) as (operator, processes):
            operator.activate("controller")
            with terminal.progress_bar("recording", samples) as progress:
                run = operator.sample(samples, progress)
            operator.record(None)
            processes.check()
            return run
    finally:
        if busy:
            burner.kill()


def _burn() -> None:
    while True:
        pass


if __name__ == "__main__":
    main()
