"""Endurance: every sample in the bag beside a busy core, or hours without a growing memory.

The simulated rig in real time with controller and recorder as processes, and beside them a process
that never rests. Every sample that was taken must be in the bag, else the exit code is 1.
Periods that a busy machine skipped are reported.

With `--hours`, hours of the arm's time as fast as the machine goes, without a recorder. The memory
that a process has taken for itself is fitted by a line from the middle of the run on: by then the
histories of the topics are full, of 1000 messages at one a second of the arm's time. A day is one
of the wall clock, in which the arm's time goes several days on: a bound of the growth in a run that
keeps pace with it. More than 1 MB a day is exit code 1.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bench.tools import json_option, write_json
from flexarm_bags.check import check_bag
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.client import SERVICE_S
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.graph.processes import NAMESPACE, LaunchError
from flexarm_bringup.graph.socket_client import NoAnswerError, socket_client
from flexarm_core.clock import Patience
from flexarm_ident.reading.read import read_bag_report

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_bringup.graph.figures import Run
    from flexarm_bringup.graph.processes import NodeProcesses

_LOOKS = 200
_DAY_S = 86400.0
_MOST_MB_A_DAY = 1.0


@click.command()
@click.option("--rate", "rate_hz", type=click.FloatRange(10.0, 2000.0), default=500.0)
@click.option("--minutes", type=click.FloatRange(0.05), default=10.0, show_default=True)
@click.option("--idle", is_flag=True, help="No busy process beside it.")
@click.option("--hours", type=click.FloatRange(0.05), help="Look at the memory for so long.")
@click.option("--page", is_flag=True, help="With --hours: a page is open beside it.")
@json_option
def main(
    *,
    rate_hz: float,
    minutes: float,
    idle: bool,
    hours: float | None,
    page: bool,
    json_file: Path | None,
) -> None:
    """Record, check the bag, print what was lost, and write the figures to a file on request."""
    if hours is not None:
        slopes = growth(rate_hz, hours, page=page)
        for name, mb in slopes.items():
            terminal.CONSOLE.print(f"{name}: {mb:+.2f} MB a day")
        write_json(json_file, {"rate_hz": rate_hz, "hours": hours, "mb_a_day": slopes})
        sys.exit(max(slopes.values()) > _MOST_MB_A_DAY)
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
        with running_graph(parameters, log, nodes=nodes, compose=False) as (
            operator,
            processes,
        ):
            operator.activate("controller")
            with terminal.progress_bar("recording", samples) as progress:
                run = operator.sample(samples, progress)
            operator.record(None)
            processes.check()
            return run
    finally:
        if busy:
            burner.kill()


def growth(rate_hz: float, hours: float, *, page: bool) -> dict[str, float]:
    """Return the growth of each process's own memory, MB a day of the wall clock, by its name."""
    parameters: dict[str, dict[str, Any]] = {
        "daq": {"rate_hz": rate_hz, "time": "virtual", "real_time_factor": 0.0},
        "controller": {"law": "pdpc", "reference": "varying_square"},
    }
    nodes = ("controller", "daq", *(["live"] if page else []))
    samples = round(3600.0 * hours * rate_hz)
    looks: list[tuple[float, dict[str, int]]] = []
    next_look = 0.0
    with tempfile.TemporaryDirectory(prefix="flexarm_endurance_") as name, ExitStack() as stack:
        log = Path(name, "nodes.log")
        operator, processes = stack.enter_context(
            running_graph(parameters, log, nodes=nodes, compose=False)
        )
        if page:
            stack.enter_context(_open_page())
        operator.activate("controller")
        bar = stack.enter_context(terminal.progress_bar("sampling", samples))

        def look(sample: int) -> None:
            bar(sample)
            nonlocal next_look
            if sample >= next_look:
                next_look = sample + samples / _LOOKS
                looks.append((time.monotonic() / _DAY_S, _memory_kb(processes)))

        operator.sample(samples, look)
    later = looks[len(looks) // 2 :]
    days = np.array([day for day, _ in later]) - later[0][0]
    return {
        name: float(np.polyfit(days, [kb[name] / 1024.0 for _, kb in later], 1)[0])
        for name in later[0][1]
    }


def _memory_kb(processes: NodeProcesses) -> dict[str, int]:
    """Return the memory that each process has taken for itself, kB."""
    found = {}
    for name, pid in processes.pids().items():
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        found[name] = next(int(line.split()[1]) for line in lines if line.startswith("Anonymous:"))
    return found


@contextmanager
def _open_page() -> Iterator[None]:
    """Read what the live node sends to a page."""
    patience = Patience(SERVICE_S)
    while True:
        try:
            with socket_client(NAMESPACE) as arm:
                address = arm.page()
            break
        except NoAnswerError:
            if patience.is_over:
                raise
            time.sleep(0.1)
    url = address.replace("http", "ws", 1).replace("/#", "/live?")
    with connect(url, max_size=None) as socket:
        threading.Thread(target=_read, args=(socket,), daemon=True).start()
        yield


def _read(socket: ClientConnection) -> None:
    with suppress(ConnectionClosed):
        while True:
            socket.recv()


def _burn() -> None:
    while True:
        pass


if __name__ == "__main__":
    main()
