"""Verbs that make models and gains, and compare with the thesis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from flexarm_bringup.verbs.verb import RUN_ON, examples

if TYPE_CHECKING:
    from collections.abc import Callable


def _methods(start: str = "") -> list[CompletionItem]:
    """Return the methods of identification that begin with a text, with their help."""
    from flexarm_ident.subspace.methods import AUTO, METHODS  # noqa: PLC0415

    rows = {AUTO: "chosen by the data"} | {row.name: row.help for row in METHODS.values()}
    return [
        CompletionItem(name, help=text) for name, text in rows.items() if name.startswith(start)
    ]


class _MethodOption(click.Option):
    """Option whose help lists the methods, read when the help is shown."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return the option and its help."""
        self.help = "; ".join(f"{item.value}: {item.help}" for item in _methods()) + "."
        return super().get_help_record(ctx)


_REQUEST_OPTIONS = (
    click.option(
        "--method",
        cls=_MethodOption,
        default="auto",
        show_default=True,
        shell_complete=lambda _context, _option, start: _methods(start),
    ),
    click.option(
        "--train-fraction",
        type=click.FloatRange(0.0, 1.0, min_open=True),
        default=0.5,
        show_default=True,
        help="Leading part of each record that is fitted.",
    ),
    click.option(
        "--block-rows", type=click.IntRange(2), default=40, show_default=True, help="q of (2-18)."
    ),
    click.option("--order", type=click.IntRange(1), help="Order of the full model; else chosen."),
    click.option(
        "--reduction",
        type=click.Choice(["none", "mrm", "msv", "mrmc"]),
        default="none",
        show_default=True,
        help="Ranking by which modes are kept.",
    ),
    click.option("--reduced-order", type=click.IntRange(1), help="States to keep; else chosen."),
    click.option(
        "--known-mode", "known_modes_hz", multiple=True, type=float, help="Hz, for mrmc; repeat."
    ),
    click.option(
        "--update",
        type=click.Choice(["none", "b", "c"]),
        default="none",
        show_default=True,
        help="Matrix that is fitted again after the reduction.",
    ),
    click.option(
        "--remove-compensation/--keep-compensation",
        default=True,
        show_default=True,
        help="Subtract the Coulomb compensation from the input.",
    ),
    click.option(
        "--stabilise/--keep-unstable",
        default=True,
        show_default=True,
        help="Move unstable eigenvalues inside the unit circle.",
    ),
    click.option(
        "--friction/--no-friction",
        default=True,
        show_default=True,
        help="Model dry friction where the data show it and carry no compensation.",
    ),
    click.option(
        "--refine/--no-refine",
        default=False,
        show_default=True,
        help="Refine the model by its simulation error; it never gets worse.",
    ),
)


def _request_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that say what is to be done with bags: the fields of a `Request`."""
    for option in reversed(_REQUEST_OPTIONS):
        function = option(function)
    return function


@click.command()
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), default=Path("out/identify"), show_default=True
)
@_request_options
@click.option(
    "--export", default="", metavar="LIST", help="Formats beside model.yaml: any of json,mat,h."
)
@examples(
    "identify bags/c_dat3_0g",
    "identify bags/c_dat3_0g --reduction mrm --reduced-order 10 --update b -o out/c3",
    "identify bags/c_dat3_0g --export json,mat,h",
    "identify bags/quanser_2dsfl --refine",
)
def identify(bags: tuple[Path, ...], out: Path, **options: Any) -> None:  # noqa: ANN401
    """Identify a model from bags, without any node; write parameters, exports and report."""
    from flexarm_bringup.offline.identify import identify_bags  # noqa: PLC0415

    identify_bags(bags, out, **options)


@click.command(context_settings={"default_map": {"reduction": "mrm", "update": "b"}})
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("out/report.html"),
    show_default=True,
    help="HTML file.",
)
@_request_options
@examples(
    "report bags/c_dat3_0g",
    "report out/run1 out/run2 -o arm.html",
    "report bags/c_dat3_0g --reduction mrmc --known-mode 9.4 --known-mode 24 --known-mode 45",
    "report bags/quanser_2dsfl --reduction none",
)
def report(bags: tuple[Path, ...], out: Path, **options: Any) -> None:  # noqa: ANN401
    """Identify, reduce by MRM, refit B, and write one HTML file that has everything inside."""
    from flexarm_bringup.offline.identify import report_bags  # noqa: PLC0415

    asked = click.get_current_context().get_parameter_source("update")
    if options["reduction"] == "none" and asked is ParameterSource.DEFAULT_MAP:
        options["update"] = "none"
    report_bags(bags, out, **options)


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
    type=click.Choice(["pdp", "pi"]),
    default="pdp",
    show_default=True,
    help="pi: one model, no weights, no margins.",
)
@click.option("--error-weight", type=click.FloatRange(0.0), default=0.5, show_default=True)
@click.option("--strain-weight", type=click.FloatRange(0.0), default=0.5, show_default=True)
@click.option("--gain-margin", "gain_margin_db", default=10.0, show_default=True, help="dB.")
@click.option("--phase-margin", "phase_margin_deg", default=55.0, show_default=True, help="deg.")
@click.option(
    "--delay", "delay_s", default=0.0, show_default=True, help="Loop delay, s, at most 0.05."
)
@examples(
    "tune nominal:0 nominal:0.2 nominal:0.4",
    "tune nominal:0:flipped nominal:0.2:flipped nominal:0.4:flipped",
    "tune bags/c_dat3_0g bags/c_dat3_400g",
    "tune out/a/model.yaml out/b/model.yaml --delay 0.001 -o out/gains.yaml",
)
def tune(models: tuple[str, ...], out: Path, **options: Any) -> None:  # noqa: ANN401
    """Tune gains on models (files from identify, bags, or nominal:KG); write a --params-file.

    nominal:KG:flipped turns the sign of the middle gauge y3, which the thesis seems to have had.
    """
    from flexarm_bringup.offline.tune import tune_models  # noqa: PLC0415

    source = click.get_current_context().get_parameter_source
    given = {k: v for k, v in options.items() if source(k) is not ParameterSource.DEFAULT}
    tune_models(models, out, **given)


@click.command(context_settings=RUN_ON, add_help_option=False)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def reproduce(arguments: tuple[str, ...]) -> None:
    """Set tables, figures and claims of the thesis beside our own, with a verdict each."""
    from flexarm_bringup.checkout.check import run_study  # noqa: PLC0415

    run_study(arguments)
