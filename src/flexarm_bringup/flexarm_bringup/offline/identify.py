"""The verbs identify and report: from bags to a folder of results or one page, without any node."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexarm_bringup.console import terminal
from flexarm_ident import job
from flexarm_ident.models.files import parse_exports
from flexarm_ident.workflow.request import Request

if TYPE_CHECKING:
    from pathlib import Path


def identify_bags(bags: tuple[Path, ...], out: Path, *, export: str, **request: Any) -> None:  # noqa: ANN401
    """Identify from bags, show stages, modes and errors, write the results."""
    exports = parse_exports(export)
    with terminal.progress() as show:
        results = job.identify_bags(bags, out, Request(**request), exports=exports, progress=show)
    _show(results)
    terminal.CONSOLE.print(f"order {results.outcome.model.nstates}, results in {out}")


def report_bags(bags: tuple[Path, ...], out: Path, **request: Any) -> None:  # noqa: ANN401
    """Identify from bags, show stages, modes and errors, write the report alone."""
    with terminal.progress() as show:
        results = job.report_bags(bags, out, Request(**request), progress=show)
    _show(results)
    terminal.CONSOLE.print(f"order {results.outcome.model.nstates}, report in {out}")


def _show(results: job.Results) -> None:
    outcome = results.outcome
    sfv = () if outcome.sfv is None else (*outcome.sfv.delta, outcome.sfv.mean)
    terminal.show_model(
        terminal.ShownModel(
            outcome.modes,
            outcome.records[0].outputs,
            (*outcome.dmv_errors, outcome.dmv_errors.mean()),
            sfv,
            results.parameters,
            outcome.warnings,
        )
    )
    if outcome.identification.choice:
        terminal.CONSOLE.print(f"  method: {outcome.identification.choice}")
