"""One model per bag: what `identify --each` shows."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_core.labels import counted
from flexarm_ident.series.rows import figures
from flexarm_ident.series.run import PAGE_FILE, TABLE_FILE, identify_each

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_ident.series.rows import Row
    from flexarm_ident.workflow.request import Request


def model_each(bags: Sequence[Path], out: Path, request: Request, **how: Any) -> None:  # noqa: ANN401
    """Identify one model per bag and print them by name; exit code 1 when a bag has none.

    Bags, folder, request and the rest are those of `identify_each`.
    """
    with terminal.progress() as show:
        series = identify_each(bags, out, request, **how, progress=show)
    terminal.show_table(_table(series.rows))
    for row in series.rows:
        if row.failure:
            terminal.CONSOLE.print(f"  no model of {row.bag}: {row.failure}")
    there = f", {series.skipped} of them there already" if series.skipped else ""
    models = counted(len(series.rows) - series.failed, "model")
    terminal.CONSOLE.print(
        f"{models}{there}; table in {out / TABLE_FILE}, trend in {out / PAGE_FILE}"
    )
    sys.exit(1 if series.failed else 0)


def _table(rows: Sequence[Row]) -> Table:
    table = Table("bag", "verdict", "order", "fit, %", "5-fold CV, %", "main modes Hz", box=None)
    for row in rows:
        table.add_row(
            row.bag,
            *figures(row),
            ", ".join(f"{hz:.4g}" for hz, _ in row.main_modes()),
        )
    return table
