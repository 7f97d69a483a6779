"""What the user sees: steps, progress, tables, one-line errors."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from flexarm_ident.modes import Mode
    from flexarm_msgs.msg import ModeSummary

# Without a terminal there is nothing to wrap for.
CONSOLE = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 110)
_PLAIN_STEPS = 10


@contextmanager
def progress_bar(text: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show how much of `total` is done; without a terminal, a line per tenth."""
    if not CONSOLE.is_terminal:
        yield _plain_progress(text, total)
        return
    columns = (TextColumn("  {task.description}"), BarColumn(), TaskProgressColumn())
    with Progress(*columns, TimeElapsedColumn(), console=CONSOLE) as progress:
        task = progress.add_task(text, total=total)
        yield lambda done: progress.update(task, completed=done)


def _plain_progress(text: str, total: int) -> Callable[[int], None]:
    shown = 0

    def show(done: int) -> None:
        nonlocal shown
        tenths = done * _PLAIN_STEPS // total
        if tenths > shown:
            shown = tenths
            CONSOLE.print(f"  {text}: {100 * tenths // _PLAIN_STEPS} %")

    return show


@contextmanager
def busy(text: str) -> Iterator[None]:
    """Show that something is being worked on."""
    if CONSOLE.is_terminal:
        with CONSOLE.status(text):
            yield
    else:
        CONSOLE.print(f"  {text}")
        yield


def step(text: str) -> None:
    """Announce a step."""
    CONSOLE.print(f"[bold]{text}[/bold]")


def mode_table(modes: Iterable[ModeSummary | Mode]) -> Table:
    """Return the table of modes as in Table 3-1a."""
    table = Table("frequency Hz", "damping", "MRM", "rank", "MSV", "rank", "kept", box=None)
    for mode in sorted(modes, key=lambda mode: mode.mrm_rank):
        frequency = f"{mode.frequency_hz:.3f}" if mode.frequency_hz > 0.0 else "real"
        table.add_row(
            frequency,
            f"{mode.damping_ratio:.4f}",
            f"{mode.mrm:.4g}",
            str(mode.mrm_rank),
            f"{mode.msv:.4g}",
            str(mode.msv_rank),
            "yes" if mode.kept else "",
        )
    return table


def error_table(outputs: Sequence[str], rows: Iterable[tuple[str, Sequence[float]]]) -> Table:
    """Return a table of relative errors (2-25), one column per output and the mean."""
    table = Table("relative error", *outputs, "mean", box=None)
    for name, errors in rows:
        table.add_row(name, *(f"{error:.4f}" for error in errors))
    return table
