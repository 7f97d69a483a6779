"""Verbs that make, play and look after bags."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click

from flexarm_bringup.verbs.verb import examples


@click.command("import")
@click.argument("csv", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--map",
    "map_file",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="YAML file that says which column is what.",
)
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Bag to create."
)
@examples("import run.csv --map columns.yaml -o bags/run")
def import_(csv: Path, map_file: Path, output: Path) -> None:
    """Turn a CSV file with named columns into a bag."""
    from flexarm_bringup.offline.files import import_measurements  # noqa: PLC0415

    click.echo(import_measurements(csv, map_file, output))


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@examples("record out/run1")
def record(bag: Path) -> None:
    """Record state, command and reference of the running graph until Ctrl-C."""
    _exec_node("recorder_node", {"bag": bag.absolute()})


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--rate", type=float, default=1.0, show_default=True, help="2 plays twice as fast.")
@click.option("--loop", is_flag=True, help="Start again at the end.")
@click.option(
    "--stand-in", is_flag=True, help="Publish the samples only, stamped now, as a DAQ node would."
)
@examples("play bags/c_dat3_0g", "play bags/c_dat3_0g --rate 2", "play bags/run1 --stand-in")
def play(bag: Path, rate: float, *, loop: bool, stand_in: bool) -> None:
    """Publish the messages of a bag with their original timing; the service ~/play stops it."""
    parameters = {"bag": bag.absolute(), "rate": rate, "loop": loop, "stand_in": stand_in}
    _exec_node("player_node", parameters)


def _exec_node(executable: str, parameters: dict[str, object]) -> None:
    from flexarm_bringup.graph.processes import NodeProgram  # noqa: PLC0415

    command = NodeProgram("flexarm_daq", executable, parameters).command()
    os.execv(command[0], command)  # noqa: S606 - our own node


@click.group()
def bag() -> None:
    """Look after bags."""


@bag.command("repair")
@click.argument("damaged", type=click.Path(exists=True, path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Bag to create."
)
@examples("bag repair out/run1 -o out/run1_repaired")
def repair(damaged: Path, output: Path) -> None:
    """Copy every whole message of a damaged bag into a new one."""
    from flexarm_bringup.offline.files import repair_bag  # noqa: PLC0415

    click.echo(repair_bag(damaged, output))


@bag.command("check")
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@examples("bag check out/run1", "bag check bags")
def check(bags: tuple[Path, ...]) -> None:
    """Find wrong bits, missing samples, wrong types and clock problems; exit code 1 if any.

    A folder of bags stands for all of them.
    """
    from flexarm_bringup.offline.files import check_bags  # noqa: PLC0415

    sys.exit(0 if check_bags(bags) else 1)
