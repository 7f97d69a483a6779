"""Verbs import, bag check and bag repair: conversion, checks and repair of bags."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_bringup.console.verb_group import examples
from flexarm_core.labels import counted

if TYPE_CHECKING:
    from flexarm_bags.repair import RepairSummary

_NEW_BAG = click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Bag to create."
)


@click.command("import")
@click.argument("csv", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--map",
    "map_file",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="YAML file that says which column is what.",
)
@_NEW_BAG
@examples("import run.csv --map columns.yaml -o bags/run")
def import_(csv: Path, map_file: Path, output: Path) -> None:
    """Turn a CSV file with named columns into a bag."""
    # They load numpy and rosbags.
    from flexarm_bags.schema import own_types, share_of  # noqa: PLC0415
    from flexarm_ident.importing.csv_import import import_csv  # noqa: PLC0415
    from flexarm_ident.importing.csv_map import load_csv_map  # noqa: PLC0415

    mapping = load_csv_map(map_file)
    made = import_csv(csv, mapping, output, typestore=own_types(), folder_of=share_of)
    for text in made.notes:
        terminal.note(f"{csv}: {text}")
    click.echo(
        f"{made.bag}: {made.samples} samples at {made.rate_hz:g} Hz, {made.duration_s:.2f} s"
    )
    if made.missing_rows or made.missing_cells:
        rows, cells = (
            counted(made.missing_rows, "row"),
            counted(made.missing_cells, "cell"),
        )
        click.echo(f"  note: {rows} and {cells} are missing: holes of the record")
    terminal.next_step(f"flexarm identify {terminal.quoted(output)}")


@click.group()
def bag() -> None:
    """Check and repair bags."""


@bag.command("repair")
@click.argument("damaged", type=click.Path(exists=True, path_type=Path))
@_NEW_BAG
@examples("bag repair out/run1 -o out/run1_repaired")
def repair(damaged: Path, output: Path) -> None:
    """Copy every whole message of a damaged bag into a new one."""
    from flexarm_bags.repair import repair_bag  # noqa: PLC0415

    made = repair_bag(damaged, output)
    lines = (
        f"{made.bag}: {made.messages} messages, {_loss(made)}",
        *(f"  damage: {line}" for line in made.damage),
    )
    for line in lines:
        terminal.CONSOLE.print(line)


def _loss(made: RepairSummary) -> str:
    if made.lost is None:
        return "an unknown number is lost: the damaged bag does not say how many it had"
    return f"{made.lost} of {made.messages + made.lost} are lost" if made.lost else "none is lost"


@bag.command("check")
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@examples("bag check out/run1", "bag check bags")
def check(bags: tuple[Path, ...]) -> None:
    """Find what is wrong with bags; exit code 1 if anything is.

    Wrong bits, missing samples, wrong types and clock problems are found. A folder of bags stands
    for all of them.
    """
    verdicts = [_is_good(each) for path in bags for each in _bags_of(path)]
    sys.exit(0 if all(verdicts) else 1)


def _is_good(bag: Path) -> bool:
    """Print what is wrong with a bag and what could not be checked; return whether it is good."""
    from flexarm_bags.check import check_bag  # noqa: PLC0415
    from flexarm_bags.metadata import repair_advice  # noqa: PLC0415

    found = check_bag(bag)
    count = len(found.problems)
    verdict = f"{count} problem{'s' * (count > 1)}" if count else "good"
    lines = (
        f"{bag}: {found.messages} messages, {verdict}",
        *(f"  problem: {problem}" for problem in found.problems),
        *(f"  note: {note}" for note in found.notes),
    )
    for line in lines:
        terminal.CONSOLE.print(line)
    if found.is_cut and (advice := repair_advice(bag)):
        terminal.CONSOLE.print(as_called(f"  {advice.removeprefix('; ')}"))
    return not found.problems


def _bags_of(path: Path) -> list[Path]:
    """Return the bags in a folder of bags; else the path itself."""
    if _has_bag_files(path):
        return [path]
    # A run that was killed leaves its record in a workplace.
    found = (folder for pattern in ("*", "*.new/*") for folder in path.glob(pattern))
    return sorted(folder for folder in found if _has_bag_files(folder)) or [path]


def _has_bag_files(folder: Path) -> bool:
    """Return whether this is a bag, whole or not."""
    from flexarm_bags.metadata import BAG_FILES  # noqa: PLC0415

    return any(any(folder.glob(pattern)) for pattern in BAG_FILES)
