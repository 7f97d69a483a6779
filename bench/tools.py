"""Shared parts of the benchmarks: options, tables, parallel trials and files of figures."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click
from rich.progress import track
from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Command = TypeVar("Command", bound=Callable[..., None])
    Case = TypeVar("Case")
    Result = TypeVar("Result")

_PROCESSES = 2
FAULTS_PAGE = Path(__file__).parents[1] / "docs" / "faults.md"
MUTANTS_HEADING = """
## Mutants

`flexarm bench mutants --docs` plants small defects, one at a time, in the modules that guard the
drive and the records: an operator, a number or a word is another one. A mutant is killed when a
unit test fails on it. Of those that live, some do the same as the original.

"""
"""Head of the last section of the page of faults, which has a benchmark of its own."""


def json_option(command: Command) -> Command:
    """Add the option `--json FILE`, the argument `json_file`."""
    kind = click.Path(dir_okay=False, path_type=Path)
    return click.option("--json", "json_file", type=kind, help="File for the figures.")(command)


def count_option(name: str, default: int) -> Callable[[Command], Command]:
    """Return the option of a positive number that is shown with its default."""
    return click.option(name, type=click.IntRange(1), default=default, show_default=True)


def first_seed_option(command: Command) -> Command:
    """Add the option `--first-seed`, which gives other records than the default's."""
    option = click.option(
        "--first-seed", type=click.IntRange(0), default=0, show_default=True, help="Of new records."
    )
    return option(command)


def make_table(*heads: str, title: str | None = None, words: int = 1) -> Table:
    """Return an empty table; the columns after the first `words` hold figures, set to the right."""
    table = Table(title=title)
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number < words else "right", no_wrap=True)
    return table


def run_trials(
    work: Callable[[Case], Result], cases: Sequence[Case], *, chunk: int = 1
) -> list[Result]:
    """Work on every case in two processes, with a progress bar; return the results in order."""
    with ProcessPoolExecutor(_PROCESSES) as pool:
        return list(track(pool.map(work, cases, chunksize=chunk), total=len(cases)))


def write_json(file: Path | None, figures: object) -> None:
    """Write figures, in which dataclasses may stand, to the file of `--json`; None: nowhere."""
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(figures, indent=1, default=asdict), "utf-8")
