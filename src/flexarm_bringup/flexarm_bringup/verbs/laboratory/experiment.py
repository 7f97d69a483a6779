"""Verbs experiment and catalogue: experiments of the thesis on the live graph, a bag each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_bringup.console.quantity import MASS_KG, Quantity
from flexarm_bringup.console.verb_group import examples, together
from flexarm_bringup.verbs.laboratory.options import ARM, PARAMETER_FILES, RIG, paced
from flexarm_daq.experiments import catalogue as experiments

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_daq.experiments.catalogue import Experiment

_WIDTH = 80
_run_options = together(
    paced,
    click.option(
        "--seed",
        type=click.IntRange(0),
        default=1,
        show_default=True,
        help="Seed of the noise and of random excitations.",
    ),
    click.option(
        "-o",
        "--out",
        "folder",
        type=click.Path(file_okay=False, path_type=Path),
        default=Path("out/experiments"),
        show_default=True,
        help="Folder that gets a bag for each.",
    ),
    click.option("--overwrite", is_flag=True, help="Replace bags that are there."),
    RIG,
    PARAMETER_FILES,
    ARM,
)
"""Options of a run: pace, seed, folder and parameter files."""


@click.command()
@click.argument("names", nargs=-1, required=True)
@click.option(
    "--payload",
    "payload_kg",
    type=Quantity(MASS_KG, 0.0, 1.0),
    metavar="MASS",
    help="Tip mass instead of the experiment's own, kg, or with its unit: 200g.",
)
@_run_options
@examples(
    "experiment C_dat3",
    "experiment B_dat9 --fast --seed 7",
    "experiment C_dat3 --payload 200g",
    "experiment O_dat2 --params-file rig.yaml",
    "experiment C_dat3 --rig my_arm.yaml",
)
def experiment(names: tuple[str, ...], **settings: Any) -> None:  # noqa: ANN401
    """Run experiments of the thesis, a bag for each.

    The simulated arm's time follows the wall clock and waits for a machine that is late: no sample
    is lost. A board runs in real time.

    Another arm has its own rate: the limits of its inputs stand for 10 V, and its travel for
    6.857 V. For those in closed loop (C_dat, R_dat) it is pulsed first, and a soft position loop
    takes the place of the controller.
    """
    entries = [experiments.experiment(name) for name in names]
    _run(entries, settings)


@click.command()
@click.argument("words", nargs=-1)
@click.option("--all", "everything", is_flag=True, help="Run all that are listed.")
@_run_options
@examples(
    "catalogue",
    "catalogue closed 400",
    "catalogue --all --fast -o out/experiments",
)
def catalogue(words: tuple[str, ...], *, everything: bool, **settings: Any) -> None:  # noqa: ANN401
    """List the experiments of the thesis, or run all of them.

    Words choose those that have all of them: a name, a kind, a payload, a rate, a law, a waveform.
    """
    entries = [each for each in experiments.catalogue().values() if _has(each, words)]
    if not entries:
        raise click.UsageError(f"no experiment has {' and '.join(words)}: leave a word out")
    if everything:
        _run(entries, settings)
    else:
        _show_catalogue(entries)
        terminal.next_step(f"flexarm experiment {entries[0].name}")


def _run(entries: Sequence[Experiment], settings: dict[str, Any]) -> None:
    # It loads ROS and what reads bags, which a list of the experiments does without.
    from flexarm_bringup.verbs.laboratory.experiment_runs import (  # noqa: PLC0415
        ExperimentSettings,
        run_experiments,
    )

    made = ExperimentSettings(**settings)
    run_experiments(entries, made)
    terminal.next_step(f"flexarm identify {terminal.quoted(made.folder / entries[-1].name)}")


def _has(entry: Experiment, words: Sequence[str]) -> bool:
    """Return whether each of the words is in the line of an experiment."""
    line = " ".join((experiments.KINDS[entry.kind], *_cells(entry))).lower()
    return all(word.lower() in line for word in words)


def _cells(entry: Experiment) -> tuple[str, ...]:
    return (
        entry.name,
        f"{entry.samples}",
        f"{entry.rate_hz:g} Hz",
        f"{1e3 * entry.payload_kg:.0f} g",
        entry.input_text,
    )


def _show_catalogue(entries: Sequence[Experiment]) -> None:
    """Print experiments, a table for each kind, in the width of any terminal."""
    for kind in dict.fromkeys(entry.kind for entry in entries):
        terminal.step(experiments.KINDS[kind])
        table = Table(box=None, header_style="")
        for title, least in (("name", 8), ("length", 6), ("rate", 6), ("payload", 7)):
            table.add_column(title, min_width=least, no_wrap=True)
        table.add_column("input")
        for entry in entries:
            if entry.kind == kind:
                table.add_row(*_cells(entry))
        terminal.CONSOLE.print(table, soft_wrap=False, width=min(_WIDTH, terminal.CONSOLE.width))
