"""Verb reproduce: tables and figures of the thesis beside our own, without any node."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from flexarm_bringup.checkout.reproduce import reproduce_subjects, show_subjects
from flexarm_bringup.console.lazy_group import examples
from flexarm_reproduction.computing import Workers


@click.command()
@click.argument("keys", nargs=-1)
@click.option("--list", "listing", is_flag=True, help="Say what there is.")
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/reproduction"),
    show_default=True,
    help="Folder of the pages.",
)
@click.option("--jobs", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--dask", default="", metavar="ADDRESS", help="Scheduler of a Dask cluster.")
@examples(
    "reproduce --list",
    "reproduce table-2-4",
    "reproduce 'figure-4-*' chapter-3",
    "reproduce all -o docs/reproduction",
    "reproduce all --dask tcp://10.0.0.7:8786",
)
def reproduce(
    keys: tuple[str, ...], out: Path, jobs: int | None, dask: str, *, listing: bool
) -> None:
    """Set tables, figures and claims of the thesis beside our own, with a verdict each."""
    if listing:
        show_subjects(keys)
        return
    if not keys:
        raise click.UsageError("say what, such as table-2-4 or all; --list says what there is")
    sys.exit(reproduce_subjects(keys, out, Workers(jobs or -1, dask)))
