"""Verb learn: repeat a reference, and improve the command by the errors of each run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.verbs.simulated.chosen_run import simulated_run
from flexarm_bringup.verbs.simulated.simulated_run import (
    ENTRY,
    REPLY_DELAY_S,
    REPORT_FILE,
    SUMMARY_FILE,
    RunSettings,
    run_options,
    versions,
)
from flexarm_control.laws.gains import TunedPdpGains
from flexarm_control.learning.columns import read_reference, write_trajectory
from flexarm_control.learning.repetition import best, improved, learned, without_model
from flexarm_control.learning.trajectory import bending_hub, planned_trajectory
from flexarm_control.loop_setup import TOPIC
from flexarm_control.planning.flat_arm import ArmFigures
from flexarm_control.planning.move import MoveSettings
from flexarm_core.outputs import require_place, write_facts
from flexarm_ident.report.content.blocks import Plots, Table, Words
from flexarm_ident.report.page import render_page
from flexarm_ident.report.plots.time_plots import step_plot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_bringup.verbs.simulated.simulated_run import SimulatedRun
    from flexarm_control.learning.repetition import Repetition
    from flexarm_control.learning.trajectory import Trajectory
    from flexarm_core.arrays import FloatArray

TRAJECTORY_FILE = "trajectory.csv"
# Half a period of the hold is a delay too.
_DELAY_S = REPLY_DELAY_S + 0.5 / ENTRY.rate_hz


@dataclass(frozen=True)
class LearnSettings(RunSettings):
    """Choices of the user: those of a run, and what is learned."""

    reference: Path
    repetitions: int
    law: str
    from_nothing: bool


@click.command()
@click.option(
    "--reference",
    type=click.Path(path_type=Path),
    required=True,
    help="CSV file with the columns time_s and reference_v; each value holds until the next one.",
)
@click.option(
    "--repetitions",
    type=click.IntRange(1, 50),
    default=8,
    show_default=True,
    help="Most repetitions after the first run.",
)
@click.option(
    "--law",
    type=click.Choice(("planned", "pdpc")),
    default="planned",
    show_default=True,
    help="Law that plays the command; both take the same file afterwards.",
)
@click.option("--from-nothing", is_flag=True, help="Begin without the command of the model.")
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), default=Path("out/learn"), show_default=True
)
@run_options
@examples(
    "learn --reference examples/square.csv --fast",
    "learn --reference examples/square.csv --repetitions 4 --payload 0.2 --law pdpc",
    "learn --reference my_path.csv --from-nothing --out out/my_path",
)
def learn(**settings: Any) -> None:  # noqa: ANN401
    """Learn the command of a motion by repeating it.

    The reference is spread to a motion that the arm can make. Each run improves the command of the
    next one. It ends when three runs have brought nothing, and the best command is kept.
    """
    _run_learn(LearnSettings(**settings))


def _run_learn(settings: LearnSettings) -> None:
    require_place([settings.out / TRAJECTORY_FILE], force=settings.force)
    arm, gains = bending_hub(ArmFigures().at(settings.payload_kg)), TunedPdpGains()
    reference_v = read_reference(settings.reference, ENTRY.rate_hz)
    first = planned_trajectory(reference_v, arm, MoveSettings().peak_v, ENTRY.rate_hz)
    if settings.from_nothing:
        first = without_model(first, gains)
    outputs_v: list[FloatArray] = []
    with simulated_run(settings) as run:
        improve = partial(improved, arm=arm, gains=gains, delay_s=_DELAY_S)

        def play(number: int, trajectory: Trajectory) -> FloatArray:
            outputs_v.append(_played(run, settings, number, trajectory))
            return outputs_v[-1]

        done = learned(play, first, improve, repetitions=settings.repetitions)
    _write(settings, done, outputs_v[best(done)])
    file = (settings.out / TRAJECTORY_FILE).absolute()
    changes = f"law={settings.law} trajectory={terminal.quoted(file)}"
    terminal.next_step(f"flexarm set controller {changes}, beside flexarm up")


def _played(
    run: SimulatedRun, settings: LearnSettings, number: int, trajectory: Trajectory
) -> FloatArray:
    """Play a trajectory on the arm, and return the outputs."""
    run.begin(f"Repetition {number}: {len(trajectory)} samples at {trajectory.rate_hz:.0f} Hz")
    # Beside the record, whose commands follow from it.
    file = settings.out.absolute() / "bag" / f"repetition_{number}.csv"
    write_trajectory(file, trajectory)
    controller = {"law": settings.law, "reference": TOPIC, "trajectory": str(file)}
    # The last sample of a record has no input after it and is left out.
    return run.repeat(number, controller, len(trajectory) + 1).reading.data.y


def _write(settings: LearnSettings, done: Sequence[Repetition], y: FloatArray) -> None:
    """Write trajectory, `summary.json` and `report.html`, and print the table."""
    out, kept = settings.out, best(done)
    write_trajectory(out / TRAJECTORY_FILE, done[kept].played)
    rows = _rows(done)
    head = ("repetition", "position mV", "gauge mV", "of the first")
    for row in (head, *rows):
        mark = "  kept" if row == rows[kept] else ""
        terminal.CONSOLE.print("  {:>10}  {:>11}  {:>8}  {:>12}".format(*row) + mark)
    write_facts(out / SUMMARY_FILE, _summary(settings, done))
    (out / REPORT_FILE).write_text(_page(head, rows, done[kept].played, y, kept), "utf-8")
    terminal.step(f"Trajectory: {out / TRAJECTORY_FILE}. {settings.results_text()}")


def _rows(done: Sequence[Repetition]) -> tuple[tuple[str, ...], ...]:
    first_v = done[0].position_rms_v
    return tuple(
        (
            str(number),
            f"{1e3 * each.position_rms_v:.1f}",
            f"{1e3 * each.strain_rms_v:.1f}",
            f"{each.position_rms_v / first_v:.3f}",
        )
        for number, each in enumerate(done)
    )


def _page(
    head: tuple[str, ...],
    rows: tuple[tuple[str, ...], ...],
    played: Trajectory,
    y: FloatArray,
    kept: int,
) -> str:
    """Return the report: differences of all repetitions, and the motion of the kept one."""
    samples = len(played)
    time_s = np.arange(samples) / played.rate_hz
    marked = tuple(number == kept for number in range(len(rows)))
    about = "root mean squares of the differences of position and middle gauge, by repetition"
    plot = step_plot(time_s, y[:samples], played.position_v, played.command_v)
    words = "The command is what is played; feedback and compensation of friction come on top."
    return render_page(
        "Learning of a command",
        [f"Repetition {kept} of {len(rows) - 1} is kept."],
        {
            "Repetitions": (Table("repetitions", about, head, rows, marked),),
            "Kept motion": (Words(words), Plots((("", plot),))),
        },
    )


def _summary(settings: LearnSettings, done: Sequence[Repetition]) -> dict[str, Any]:
    kept = best(done)
    return {
        "payload_kg": settings.payload_kg,
        "seed": settings.seed,
        "law": settings.law,
        "from_nothing": settings.from_nothing,
        "kept": kept,
        "ratio": done[kept].position_rms_v / done[0].position_rms_v,
        "repetitions": [
            {
                "position_rms_v": each.position_rms_v,
                "middle_strain_rms_v": each.strain_rms_v,
                "weighted_v": each.weighted_v,
            }
            for each in done
        ],
        "versions": versions(),
    }
