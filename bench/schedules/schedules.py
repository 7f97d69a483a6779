"""Fault schedules: the whole graph by seeds, in virtual time, with its invariants checked.

Loop, controller or experiment and recorder run in one process on a clock of their own. Messages
are late, lost, doubled and out of order, processes stand still and die, the disk is full, sensors
break and the wall clock jumps, all by a seed. A seed that fails is run again, which must give the
same to the bit, and its list of events is made as short as it can be.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import click

from bench.schedules.schedule import LENGTH_S, draw
from bench.schedules.shrink import shrunk
from bench.schedules.simulation import Outcome, run
from bench.tools import (
    FAULTS_PAGE,
    count_option,
    first_seed_option,
    json_option,
    make_table,
    write_json,
    write_table,
)
from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import VerbGroup
from flexarm_core.workers import Workers, computed

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bench.schedules.schedule import Schedule

_SEEDS_A_TASK = 20
_HEADS = ("seeds", "samples", "violations", "wall s", "cpu s", "times real time")


@dataclass(frozen=True)
class Failure:
    """A seed that fails.

    `events` are those of the shrunk schedule, `violation` what it violates; `repeats` says whether
    the seed did the same to the bit when it was run again.
    """

    seed: int
    violation: str
    repeats: bool
    schedule: str
    events: int


@dataclass(frozen=True)
class Figures:
    """Figures of a campaign.

    `times_real_time` is the arm's time in all runs by the time that the campaign took.
    """

    seeds: int
    samples: int
    failures: tuple[Failure, ...]
    wall_s: float
    cpu_s: float
    times_real_time: float


@click.group(cls=VerbGroup)
def main() -> None:
    """Give this program the error lines and exit codes of the command `flexarm`."""


@main.command("schedules")
@count_option("--seeds", 1000)
@first_seed_option
@click.option("--seed", type=click.IntRange(0), help="One seed, with its schedule.")
@click.option("--jobs", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--dask", default="", metavar="ADDRESS", help="Scheduler of a Dask cluster.")
@json_option
@click.option("--docs", is_flag=True, help="Write the table of docs/faults.md.")
def command(
    *,
    seeds: int,
    first_seed: int,
    seed: int | None,
    jobs: int | None,
    dask: str,
    json_file: Path | None,
    docs: bool,
) -> None:
    """Run the graph by seeds; exit code 1 when an invariant does not hold."""
    if seed is not None:
        first_seed, seeds = seed, 1
        terminal.CONSOLE.print(str(draw(seed)))
    figures = campaign(range(first_seed, first_seed + seeds), Workers(jobs or -1, dask))
    for failure in figures.failures:
        terminal.CONSOLE.print(described(failure))
    table = make_table(*_HEADS, words=0)
    table.add_row(*_cells(figures))
    terminal.CONSOLE.print(table)
    write_json(json_file, asdict(figures))
    if docs:
        write_table(FAULTS_PAGE, "schedules", _HEADS, [_cells(figures)])
    sys.exit(1 if figures.failures else 0)


def _cells(figures: Figures) -> tuple[str, ...]:
    return (
        str(figures.seeds),
        str(figures.samples),
        str(len(figures.failures)),
        f"{figures.wall_s:.0f}",
        f"{figures.cpu_s:.0f}",
        f"{figures.times_real_time:.0f}",
    )


def campaign(seeds: Sequence[int], workers: Workers) -> Figures:
    """Run all seeds.

    Raises
    ------
    WorkersError
        Without a cluster to compute on.
    """
    begun_s = time.monotonic()
    tasks = [(tuple(seeds[k : k + _SEEDS_A_TASK]),) for k in range(0, len(seeds), _SEEDS_A_TASK)]
    outcomes: list[Outcome] = []
    failures: list[Failure] = []
    with terminal.progress() as show:
        for number, found, failure in computed(run_seeds, tasks, workers):
            if failure:
                raise click.ClickException(f"seeds from {tasks[number][0][0]} on: {failure}")
            outcomes += found[0]
            failures += found[1]
            show(f"{len(failures)} violations", len(outcomes) / len(seeds))
    wall_s = time.monotonic() - begun_s
    return Figures(
        len(seeds),
        sum(outcome.samples for outcome in outcomes),
        tuple(sorted(failures, key=lambda failure: failure.seed)),
        wall_s,
        sum(outcome.cpu_s for outcome in outcomes),
        len(seeds) * LENGTH_S / wall_s,
    )


def run_seeds(seeds: Sequence[int]) -> tuple[list[Outcome], list[Failure]]:
    """Run seeds one after the other, in a worker; look into those that fail."""
    outcomes = [run(draw(seed)) for seed in seeds]
    return outcomes, [examined(outcome) for outcome in outcomes if outcome.violation]


def examined(outcome: Outcome) -> Failure:
    """Run a seed that failed again, and shrink its schedule."""
    schedule = draw(outcome.seed)
    again = run(schedule)
    smallest = shrunk_schedule(schedule)
    return Failure(
        outcome.seed,
        run(smallest).violation or outcome.violation,
        replace(again, cpu_s=0.0) == replace(outcome, cpu_s=0.0),
        str(smallest),
        len(smallest.events),
    )


def shrunk_schedule(schedule: Schedule) -> Schedule:
    """Return a schedule that fails with as few events of the given one as possible."""
    return schedule.of(
        shrunk(schedule.events, lambda events: bool(run(schedule.of(tuple(events))).violation))
    )


def described(failure: Failure) -> str:
    """Return a failure in words."""
    repeated = (
        "" if failure.repeats else "\n  It does NOT repeat: run again, it did something else."
    )
    return f"{failure.schedule}\n  -> {failure.violation}{repeated}"


if __name__ == "__main__":
    main(["schedules", *sys.argv[1:]], prog_name="flexarm bench")
