"""The verb identify: from bags to a folder of results, without any node."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from flexarm_bringup import terminal
from flexarm_ident import job
from flexarm_ident.exports import parse_exports
from flexarm_ident.workflow import Request

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


def identify_bags(bags: tuple[Path, ...], out: Path, *, export: str, **request: Any) -> None:  # noqa: ANN401
    """Identify from bags, show stages, modes and errors, write the results."""
    exports = parse_exports(export)
    with _stages() as progress:
        results = job.identify_bags(
            bags, out, Request(**request), exports=exports, progress=progress
        )
    outcome = results.outcome
    rows = [("data (DMV)", [*outcome.dmv_errors, outcome.dmv_errors.mean()])]
    if outcome.sfv is not None:
        rows.append(("set-point (SFV)", [*outcome.sfv.delta, outcome.sfv.mean]))
    console = terminal.CONSOLE
    console.print(terminal.mode_table(outcome.modes))
    console.print(terminal.error_table(outcome.records[0].outputs, rows))
    for warning in outcome.warnings:
        console.print(f"note: {warning}")
    console.print(f"order {outcome.model.nstates}, results in {out}")


@contextmanager
def _stages() -> Iterator[Callable[[str, float], None]]:
    """Show the stage and how much of the whole is done; without a terminal, a line per stage."""
    if not terminal.CONSOLE.is_terminal:
        yield _plain_stages()
        return
    columns = (TextColumn("  {task.description:12}"), BarColumn(), TaskProgressColumn())
    with Progress(*columns, TimeElapsedColumn(), console=terminal.CONSOLE) as progress:
        task = progress.add_task("", total=1.0)
        yield lambda stage, done: progress.update(task, description=stage, completed=done)


def _plain_stages() -> Callable[[str, float], None]:
    shown = ""

    def show(stage: str, done: float) -> None:
        nonlocal shown
        if stage != shown:
            shown = stage
            terminal.CONSOLE.print(f"  {100.0 * done:3.0f} % {stage}")

    return show
