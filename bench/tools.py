"""Shared parts of the benchmarks: options, tables, parallel trials and files of figures."""

from __future__ import annotations

import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from rich.progress import track
from rich.table import Table

from flexarm_bringup.console.verb_group import FORCE
from flexarm_core.outputs import MARK_KEY, OutputError, require_place

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_bringup.graph.processes import NodeProcesses

    Command = Callable[..., None]
    Case = TypeVar("Case")
    Result = TypeVar("Result")

_PROCESSES = 2
FAULTS_PAGE = Path(__file__).parents[1] / "docs" / "faults.md"
"""Page with the tables of three benchmarks."""


def json_option(command: Command) -> Command:
    """Add the option `--json FILE`, the argument `json_file`, and `--force`.

    What the file is refused for is found before anything is measured.
    """

    @click.option(
        "--json", "json_file", type=click.Path(path_type=Path), help="File for the figures."
    )
    @FORCE
    @wraps(command)
    def checked(*, json_file: Path | None, force: bool, **settings: Any) -> None:  # noqa: ANN401
        try:
            require_place([] if json_file is None else [json_file], force=force)
        except OutputError as error:
            raise click.ClickException(str(error)) from None
        command(json_file=json_file, **settings)

    return checked


def count_option(name: str, default: int) -> Callable[[Command], Command]:
    """Return the option of a positive number that is shown with its default."""
    return click.option(name, type=click.IntRange(1), default=default, show_default=True)


def first_seed_option(command: Command) -> Command:
    """Add the option `--first-seed`, which gives other records than the default's."""
    option = click.option(
        "--first-seed", type=click.IntRange(0), default=0, show_default=True, help="Of new records."
    )
    return option(command)


def typed_environment() -> dict[str, str]:
    """Return the environment of a terminal in which no `flexarm` has run yet."""
    set_by_flexarm = {"FLEXARM_ROOT"}
    # On a bare machine the ROS packages are flexarm's own, too.
    if "_ROS_WHEELS_BOOTSTRAP_COMPLETE" in os.environ:
        set_by_flexarm.add("AMENT_PREFIX_PATH")
    return {name: value for name, value in os.environ.items() if name not in set_by_flexarm}


def make_table(*heads: str, title: str | None = None, words: int = 1) -> Table:
    """Return an empty table; the columns after the first `words` hold figures, set to the right."""
    table = Table(title=title)
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number < words else "right", no_wrap=True)
    return table


def write_table(page: Path, name: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write the table of a benchmark into a page, between the two comments with its name.

    Raises
    ------
    ValueError
        If the page does not have both comments.
    """
    lines = [heads, ["---"] * len(heads), *rows]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    before, begin, rest = page.read_text("utf-8").partition(f"<!-- bench {name} -->\n")
    _, end, after = rest.partition(f"<!-- end of bench {name} -->")
    if not end:
        raise ValueError(f"{page}: no place for the table of bench {name} is marked in it")
    page.write_text(f"{before}{begin}{table}\n{end}{after}", "utf-8")


def run_trials(
    work: Callable[[Case], Result], cases: Sequence[Case], *, chunk: int = 1
) -> list[Result]:
    """Work on every case in two processes, with a progress bar; return the results in order."""
    with ProcessPoolExecutor(_PROCESSES) as pool:
        return list(track(pool.map(work, cases, chunksize=chunk), total=len(cases)))


def write_json(file: Path | None, figures: dict[str, Any] | Sequence[Any]) -> None:
    """Write figures to the file of `--json`; None: nowhere.

    Parameters
    ----------
    file : Path or None
        File, which gets the mark of a file of flexarm.
    figures : dict, or sequence of dicts or dataclasses
        Figures, in which dataclasses may stand; the first of several rows has the mark.
    """
    if file is None:
        return
    marked: object = figures
    if isinstance(figures, dict):
        marked = MARK_KEY | figures
    elif figures:
        first, *others = figures
        row = first if isinstance(first, dict) else asdict(first)
        marked = [MARK_KEY | row, *others]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(marked, indent=1, default=asdict), "utf-8")


def cpu_s(processes: NodeProcesses) -> dict[str, float]:
    """Return the CPU time that each process has used, s, by the name of its executable."""
    return {name: process_cpu_s(pid) for name, pid in processes.pids().items()}


def process_cpu_s(pid: int) -> float:
    """Return the CPU time that a process has used, s."""
    # The second field, the name, may contain blanks.
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    user, system = fields[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
