"""Fault campaign: every fault of the rig, and processes killed at random moments.

Broken rigs are tried in virtual time, each with several seeds. Controllers and DAQ nodes are killed
with SIGKILL in a graph of real nodes, and what happened is read from the samples. Time is counted
in periods of the DAQ node.
"""

from __future__ import annotations

import signal
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.table import Table

from bench.tools import FAULTS_PAGE, count_option, json_option, write_json, write_table
from flexarm_bringup.console import terminal

_ROOT = Path(__file__).parents[2]
# The campaign shares its injections and its graph with the tests.
sys.path.insert(0, str(_ROOT / "test"))

from flexarm_daq.rigs.faulty import SENSOR_FAULTS  # noqa: E402
from support.fault_campaign import MAX_AGE_PERIODS, Campaign, random_moments_s  # noqa: E402
from support.fault_injection import CASES, RATE_HZ, inject  # noqa: E402
from support.system_graph import Graph  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_BATCH = 10
"""Controllers that are started together."""
_DAQ_KILLS = 10
_DAQ = {"rate_hz": RATE_HZ, "time": "real"}
_HEADS = ("fault", "where", "stopped", "median", "largest", "outcome")


@dataclass(frozen=True)
class Row:
    """One kind of fault.

    `stopped` of `trials` ended with the drive at zero for good; `median` and `largest` are the
    periods it took; `outcome` is what the diagnostics say, in the most frequent case.
    """

    fault: str
    where: str
    trials: int
    stopped: int
    median: float | None
    largest: int | None
    outcome: str


@click.command()
@count_option("--kills", 100)
@count_option("--seeds", 20)
@json_option
@click.option("--docs", is_flag=True, help="Write the table of docs/faults.md.")
def main(*, kills: int, seeds: int, json_file: Path | None, docs: bool) -> None:
    """Inject every fault, print one table, and write it to files on request."""
    rows = []
    for row in (*broken_rigs(seeds), *killed_processes(kills)):
        rows.append(row)
        terminal.CONSOLE.print(
            f"{row.fault} {row.where}: {row.stopped} of {row.trials}", style="dim"
        )
    terminal.show_table(table(rows))
    write_json(json_file, rows)
    if docs:
        write_table(FAULTS_PAGE, "faults", _HEADS, list(map(_cells, rows)))


def broken_rigs(seeds: int) -> Iterator[Row]:
    """Break the rig in every way."""
    for fault, channel in CASES:
        trials = [inject(fault, channel, seed) for seed in range(seeds)]
        if not all(trial.ended_at_zero for trial in trials):
            raise click.ClickException(f"{fault.value} {channel}: the drive did not end at zero")
        reasons = Counter(_without_figures(trial.reason) for trial in trials)
        yield Row(
            fault.value.replace("_", " "),
            channel if fault in SENSOR_FAULTS else "rig",
            len(trials),
            *_summary([trial.periods for trial in trials]),
            reasons.most_common(1)[0][0] or "rides through: the limiter bounds the command",
        )


def killed_processes(kills: int) -> Iterator[Row]:
    """Kill controllers and DAQ nodes while the arm is driven."""
    with tempfile.TemporaryDirectory() as folder, Graph(Path(folder)) as graph:
        campaign = Campaign(graph, Path(folder))
        campaign.start(_DAQ)
        campaign.activate()
        moments = iter(random_moments_s(kills, seed=1))
        periods = []
        while batch := list(islice(moments, _BATCH)):
            for kill in campaign.kill_controllers(batch):
                periods.append(kill.periods)
                if not 1 <= kill.periods <= MAX_AGE_PERIODS:
                    raise click.ClickException(f"the drive was not at zero in time: {kill}")
        yield Row(
            "killed (SIGKILL)",
            "controller",
            kills,
            *_summary(periods),
            "the command is stale; every bag is readable and has no gap",
        )
        assert graph.transition("daq", "deactivate")  # noqa: S101 - as in the tests
        campaign.start_controller()
        yield from _ended_daq(campaign)


def _ended_daq(campaign: Campaign) -> Iterator[Row]:
    """End the DAQ node in every way while it drives."""
    for stop in (signal.SIGINT, signal.SIGTERM):
        stopped = 0
        for _ in range(_DAQ_KILLS):
            code = campaign.stop_daq(stop)
            stopped += code == 0 and "samples, the drive is at zero" in campaign.daq.printed
            campaign.restart_daq(_DAQ)
        yield Row(stop.name, "daq", _DAQ_KILLS, stopped, None, None, "the zero is written first")
    for moment_s in random_moments_s(_DAQ_KILLS, seed=2):
        run = campaign.kill_daq(moment_s)
        if not (run.command_v.any() and np.all(np.diff(run.sequence) > 0)):
            raise click.ClickException("the bag of a killed DAQ node has a gap")
        campaign.restart_daq(_DAQ)
    yield Row(
        "killed (SIGKILL)",
        "daq",
        _DAQ_KILLS,
        0,
        None,
        None,
        "nobody is left to write the zero: see safety.md; every bag is readable and has no gap",
    )


def table(rows: Sequence[Row]) -> Table:
    """Return the table for the terminal."""
    made = Table("fault", "where", "stopped", "periods: median", "largest", "outcome")
    for row in rows:
        made.add_row(*_cells(row))
    return made


def _cells(row: Row) -> tuple[str, ...]:
    median = "" if row.median is None else f"{row.median:g}"
    largest = "" if row.largest is None else str(row.largest)
    return row.fault, row.where, f"{row.stopped} of {row.trials}", median, largest, row.outcome


def _summary(periods: Sequence[int | None]) -> tuple[int, float | None, int | None]:
    """Return how many stopped, and median and largest of the periods it took them."""
    stopped = [each for each in periods if each is not None]
    if not stopped:
        return 0, None, None
    return len(stopped), float(np.median(stopped)), max(stopped)


def _without_figures(reason: str) -> str:
    """Cut a reason where its figures begin, so that equal causes are equal."""
    for mark in (" at ", " by ", " after "):
        head, found, tail = reason.rpartition(mark)
        if found and tail[:1] in "-0123456789":
            return head
    return reason


if __name__ == "__main__":
    main()
