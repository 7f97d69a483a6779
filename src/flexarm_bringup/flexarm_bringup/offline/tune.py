"""The verb tune: from models to a parameter file of gains, without any node."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_control.design.tuning_job import TuneRequest, load_models, tune
from flexarm_ident.models.ros_yaml import write_parameter_file

if TYPE_CHECKING:
    from pathlib import Path


def tune_models(names: tuple[str, ...], out: Path, **request: Any) -> None:  # noqa: ANN401
    """Tune a law on models, show the certificate, write the gains.

    Raises
    ------
    OSError
        When the gains could not be written; that is tried before the search.
    """
    _make_writable(out)
    with terminal.busy(f"tuning on {len(names)} models"):
        models = load_models(names)
        result = tune(models, TuneRequest(**request))
    table = Table("model", "gain margin dB", "phase margin deg", "disk margin", "E", "Y", box=None)
    rows = zip(models, result.margins, result.error_itae, result.strain_itae, strict=False)
    for name, margins, error, strain in rows:
        disk = f"{margins.disk_margin:.2f} at {margins.disk_margin_hz:.1f} Hz"
        table.add_row(
            name,
            f"{margins.gain_margin_db:.2f}",
            f"{margins.phase_margin_deg:.1f}",
            disk,
            f"{error:.3f}",
            f"{strain:.3f}",
        )
    if table.row_count:
        terminal.CONSOLE.print(table)
    for note in result.notes:
        terminal.CONSOLE.print(f"  {note}")
    write_parameter_file(out, dict(result.parameters), node="/flexarm/controller")
    gains = ", ".join(f"{name} {gain:.4f}" for name, gain in list(result.parameters.items())[:3])
    terminal.CONSOLE.print(f"J {result.criteria[0]:.4f}: {gains}; written to {out}")


def _make_writable(out: Path) -> None:
    """Make the folder of a file, and see that the file can be written, without a trace of it."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        is_new = not out.exists()
        out.open("a").close()
        if is_new:
            out.unlink()
    except OSError as error:
        raise OSError(f"{out}: cannot be written: {error.strerror}") from error
