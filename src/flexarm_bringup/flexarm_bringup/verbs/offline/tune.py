"""Verb tune: from models to a parameter file of gains, without any node."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource
from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_bringup.console.quantity import TIME_S, FiniteRange, Quantity
from flexarm_bringup.console.verb_group import FORCE, examples
from flexarm_control.design.model_sources import friction_levels_v, load_models
from flexarm_control.design.tuning_job import TUNINGS, TuneRequest
from flexarm_control.design.tuning_job import tune as tune_gains
from flexarm_core.outputs import require_place
from flexarm_ident.models.model_parameters import write_parameter_file

if TYPE_CHECKING:
    from flexarm_control.design.tuning_job import TuneResult


@click.command()
@click.argument("models", nargs=-1, required=True)
@click.option(
    "-o",
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("out/gains.yaml"),
    show_default=True,
)
@click.option(
    "--law",
    type=click.Choice(tuple(TUNINGS)),
    default="pdp",
    show_default=True,
    help="pi: one model, no weights, no margins; pdpc_scheduled: three payloads; ilqr and lqg: "
    "designed on the first model, checked on all.",
)
@click.option("--error-weight", type=FiniteRange(0.0), default=0.5, show_default=True)
@click.option("--strain-weight", type=FiniteRange(0.0), default=0.5, show_default=True)
@click.option("--gain-margin", "gain_margin_db", default=10.0, show_default=True, help="dB.")
@click.option("--phase-margin", "phase_margin_deg", default=55.0, show_default=True, help="deg.")
@click.option(
    "--delay",
    "delay_s",
    type=Quantity(TIME_S, 0.0, 0.05),
    metavar="TIME",
    default=0.0,
    show_default=True,
    help="Loop delay, s, or with its unit: 0.5ms.",
)
@click.option(
    "--duration",
    "duration_s",
    type=Quantity(TIME_S, 0.0, 60.0),
    metavar="TIME",
    default=5.0,
    show_default=True,
    help="Length of the step of the criterion; the gains do not depend on its size.",
)
@FORCE
@examples(
    "tune nominal:0 nominal:0.2 nominal:0.4",
    "tune nominal:0:flipped nominal:0.2:flipped nominal:0.4:flipped",
    "tune bags/c_dat3_0g bags/c_dat3_400g",
    "tune out/a/model.yaml out/b/model.yaml --delay 0.001 -o out/gains.yaml",
    "tune --law ilqr out/150g/model.yaml",
    "tune --law pdpc_scheduled 0=out/a/model.yaml 0.15=out/b/model.yaml 0.3=out/c/model.yaml",
)
def tune(models: tuple[str, ...], out: Path, *, force: bool, **options: Any) -> None:  # noqa: ANN401
    """Tune gains on models and write a --params-file.

    A model is a file from identify, a bag, or nominal:KG; KG=MODEL gives its payload.

    nominal:KG:flipped turns the sign of the middle gauge y3, which the thesis seems to have had.
    """
    source = click.get_current_context().get_parameter_source
    given = {k: v for k, v in options.items() if source(k) is not ParameterSource.DEFAULT}
    rate_hz = tune_models(models, out, force=force, **given)
    law = "pdpc" if options["law"] == "pdp" else options["law"]
    file = terminal.quoted(out)
    terminal.next_step(
        f"flexarm up --law {law} --rate {rate_hz:.6g} --params-file {file} --reference square"
    )


def tune_models(
    names: tuple[str, ...],
    out: Path,
    *,
    force: bool = False,
    **request: Any,  # noqa: ANN401 - whatever its type
) -> float:
    """Tune a law on models, show the certificate, write the gains.

    Parameters
    ----------
    names : tuple of str
        Models, as the verb takes them.
    out : Path
        File of the gains.
    force : bool
        Another file than one of gains is replaced too.
    **request
        Fields of a `TuneRequest`.

    Returns
    -------
    float
        Rate of the first model, for which the gains are, Hz.

    Raises
    ------
    OutputError
        When the gains cannot be written, or would replace a file of somebody else; found before
        the search.
    """
    require_place([out], force=force)
    with terminal.busy(f"tuning on {len(names)} model{'s' * (len(names) != 1)}"):
        models = load_models(names)
        result = tune_gains(models, TuneRequest(**request), friction_levels_v(names))
    _show_certificate(tuple(models), result)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_parameter_file(out, dict(result.parameters), node="/**/controller")
    terminal.CONSOLE.print(f"J {result.criteria[0]:.4f}: {_of_first_law(result)}; written to {out}")
    return 1.0 / float(next(iter(models.values())).dt)


def _show_certificate(names: tuple[str, ...], result: TuneResult) -> None:
    """Print margins and criteria for each model, and notes."""
    table = Table("model", "gain margin dB", "phase margin deg", "disk margin", "E", "Y", box=None)
    rows = zip(names, result.margins, result.error_itae, result.strain_itae, strict=False)
    for name, margins, error, strain in rows:
        table.add_row(
            name,
            f"{margins.gain_margin_db:.2f}",
            f"{margins.phase_margin_deg:.1f}",
            f"{margins.disk_margin:.2f} at {margins.disk_margin_hz:.1f} Hz",
            f"{error:.3f}",
            f"{strain:.3f}",
        )
    if table.row_count:
        terminal.show_table(table)
    for line in (*result.explanation, *result.notes):
        terminal.CONSOLE.print(f"  {line}")


def _of_first_law(result: TuneResult) -> str:
    """Return the parameters of the first law; those of others have the same values."""
    law = next(iter(result.parameters)).partition(".")[0] + "."
    values = {name: each for name, each in result.parameters.items() if name.startswith(law)}
    return ", ".join(f"{name} {_text(each)}" for name, each in values.items())


def _text(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
