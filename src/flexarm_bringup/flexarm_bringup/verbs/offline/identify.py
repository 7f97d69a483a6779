"""Verbs identify and report: from bags to a folder of results or one page, without any node."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_bringup.console.quantity import FREQUENCY_HZ, FiniteRange, Quantity
from flexarm_bringup.console.verb_group import FORCE, examples, together
from flexarm_bringup.verbs.offline.channel_options import (
    channel_options,
    taken_part,
)
from flexarm_core.channels import CHANNEL_NAMES
from flexarm_ident import job
from flexarm_ident.diagnostics.verdict import Level
from flexarm_ident.models.files import parse_exports
from flexarm_ident.records.preprocess import BIASES
from flexarm_ident.report.summary import headline
from flexarm_ident.subspace.methods import AUTO, METHODS
from flexarm_ident.workflow.request import FEEDTHROUGH, REDUCTIONS, UPDATES, Request

if TYPE_CHECKING:
    from flexarm_ident.job import Results

_METHODS = {AUTO: "chosen by the data"} | {row.name: row.help for row in METHODS.values()}


def _methods(_: click.Context, __: click.Parameter, start: str) -> list[CompletionItem]:
    """Return the methods of identification that begin with a text, with their help."""
    return [
        CompletionItem(name, help=text) for name, text in _METHODS.items() if name.startswith(start)
    ]


_request_options = together(
    click.option(
        "--method",
        default="auto",
        show_default=True,
        help="; ".join(f"{name}: {text}" for name, text in _METHODS.items()) + ".",
        shell_complete=_methods,
    ),
    click.option(
        "--train-fraction",
        type=FiniteRange(0.0, 1.0, min_open=True),
        default=1.0,
        show_default=True,
        help="Leading part of each record that is fitted.",
    ),
    click.option(
        "--block-rows",
        type=click.IntRange(2),
        help="q of (2-18); else 40, fewer for short records.",
    ),
    click.option("--order", type=click.IntRange(1), help="Order of the full model; else chosen."),
    click.option(
        "--singular-value-threshold",
        type=FiniteRange(0.0, 1.0, min_open=True, max_open=True),
        help="Threshold of (2-22), a part of the largest singular value: sets the order.",
    ),
    click.option(
        "--feedthrough",
        type=click.Choice(list(FEEDTHROUGH)),
        default="auto",
        show_default=True,
        help="Whether D is fitted.",
    ),
    click.option(
        "--bias",
        type=click.Choice(BIASES),
        show_default="rest; first with orse_thesis",
        help="Offset removed from the outputs: mean of the initial rest, first sample, or mean.",
    ),
    click.option(
        "--cutoff",
        "cutoff_hz",
        type=Quantity(FREQUENCY_HZ, 0.0),
        metavar="FREQUENCY",
        help="Low-pass filter, Hz; none by default, 50 on the outputs with orse_thesis.",
    ),
    click.option(
        "--filter-input/--filter-outputs-only",
        default=True,
        show_default=True,
        help="Signals that the low-pass filter takes.",
    ),
    click.option(
        "--reduction",
        type=click.Choice(REDUCTIONS),
        default="none",
        show_default=True,
        help="Ranking by which modes are kept.",
    ),
    click.option("--reduced-order", type=click.IntRange(1), help="States to keep; else chosen."),
    click.option(
        "--known-mode",
        "known_modes_hz",
        multiple=True,
        type=Quantity(FREQUENCY_HZ, 0.0),
        metavar="FREQUENCY",
        help="Hz, for mrmc; repeat.",
    ),
    click.option(
        "--update",
        type=click.Choice(UPDATES),
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
        help="Refine the model: maximum likelihood, or simulation error where it is not noise.",
    ),
)
"""Options that say what is to be done with bags: the fields of a `Request`."""


_PAGES = (".html", ".htm")
_MAP = click.option(
    "--map",
    "map_file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="YAML file that says which column of a CSV file is what.",
)


@click.command()
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), default=Path("out/identify"), show_default=True
)
@_MAP
@channel_options
@_request_options
@click.option(
    "--export", default="", metavar="LIST", help="Formats beside model.yaml: any of json,mat,h."
)
@click.option(
    "--output-only",
    is_flag=True,
    help="Modes of records without an input, such as logs of an accelerometer; and input shapers.",
)
@click.option("--each", is_flag=True, help="One model per bag, in a table with their trend.")
@click.option("--jobs", type=click.IntRange(1), help="Processes of --each; else one per core.")
@click.option(
    "--dask", default="", metavar="ADDRESS", help="Scheduler of a Dask cluster, for --each."
)
@click.option("--parquet", is_flag=True, help="The table of --each as Parquet too.")
@FORCE
@examples(
    "identify bags/c_dat3_0g",
    "identify bags/c_dat3_0g --reduction mrm --reduced-order 10 --update b -o out/c3",
    "identify bags/c_dat3_0g --export json,mat,h",
    "identify bags/quanser_2dsfl --refine",
    "identify run1 --input /command.data --output '/joint_states.position[0]'",
    "identify run.csv --input torque --output angle",
    "identify run.csv --map columns.yaml",
    "identify raw_data_x.csv --output-only",
    "identify run1 --from 4s --to 30s",
    "identify --each runs/* -o out/months",
)
def identify(
    bags: tuple[Path, ...],
    out: Path,
    *,
    map_file: Path | None,
    export: str,
    each: bool,
    jobs: int | None,
    dask: str,
    parquet: bool,
    force: bool,
    **options: Any,  # noqa: ANN401
) -> None:
    """Identify a model from bags; write parameters and report.

    A CSV file is a bag too: --input and --output name its columns, or a map describes them.
    """
    for path in bags:
        if path.name == job.MODEL_FILE or (path / job.MODEL_FILE).is_file():
            raise click.UsageError(f"{path} is a model: name the bag or the CSV file of a record")
    if (out / "metadata.yaml").is_file():
        raise click.UsageError(f"-o {out} is a bag: name a folder of its own for the results")
    output_only = options["output_only"]
    if output_only and (each or export):
        raise click.UsageError("--output-only makes no model: leave out --each and --export")
    if output_only and (options["inputs"] or map_file):
        raise click.UsageError("--output-only takes no --input and no --map: leave one of them out")
    part, exports = taken_part(bags, options, map_file), parse_exports(export)
    if output_only and Request(**options) != Request():
        raise click.UsageError("--output-only makes no model: leave out the options of one")
    if not each and (jobs is not None or dask or parquet):
        raise click.UsageError("--jobs, --dask and --parquet belong to --each")
    if output_only:
        # It loads the shapers.
        from flexarm_bringup.verbs.offline.output_only import show_modes  # noqa: PLC0415

        show_modes(bags, out, **part, force=force)
        return
    if each:
        # They load matplotlib and joblib.
        from flexarm_bringup.verbs.offline.series import model_each  # noqa: PLC0415
        from flexarm_core.workers import Workers  # noqa: PLC0415

        model_each(
            bags,
            out,
            Request(**options),
            **part,
            exports=exports,
            force=force,
            parquet=parquet,
            workers=Workers(jobs or -1, dask),
        )
        return
    former = job.model_in(out)
    with terminal.progress() as show:
        results = job.identify_bags(
            bags,
            out,
            Request(**options),
            **part,
            exports=exports,
            force=force,
            progress=show,
        )
    replaced = f", in place of those of {former}" if former not in {"", results.name} else ""
    _show(results, f"results in {out}{replaced}", as_called(_after(results, out)))


@click.command()
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("out/report.html"),
    show_default=True,
    help="HTML file.",
)
@click.option("--open", "opens", is_flag=True, help="Open the report in a browser.")
@_MAP
@channel_options
@_request_options
@FORCE
@examples(
    "report bags/c_dat3_0g --open",
    "report bags/c_dat3_0g bags/c_dat3_400g -o both.html",
    "report out/before out/after bags/c_dat3_0g",
    "report bags/c_dat3_0g --reduction mrmc --known-mode 9.4 --known-mode 24 --known-mode 45",
)
def report(
    bags: tuple[Path, ...],
    out: Path,
    *,
    opens: bool,
    map_file: Path | None,
    force: bool,
    **options: Any,  # noqa: ANN401
) -> None:
    """Identify as the verb identify does; write one HTML file.

    Several bags or models are compared: each bag gives a model, tried on the records of all.
    """
    if len(bags) == 1 and (bags[0] / job.MODEL_FILE).exists():
        raise click.UsageError(f"{bags[0]} is a model: name a bag beside it, to try it on")
    if out.suffix.lower() not in _PAGES:
        raise click.UsageError(f"-o {out}: the report is one page: {out.with_suffix('.html')}")
    part = taken_part(bags, options, map_file)
    with terminal.progress() as show:
        if len(bags) > 1:
            from flexarm_ident.series.comparison import compare_files  # noqa: PLC0415 - a rare way

            lines = compare_files(bags, out, Request(**options), **part, force=force, progress=show)
            for line in (*lines, f"report in {out}"):
                terminal.CONSOLE.print(line)
            _open(out, opens=opens)
            return
        results = job.report_bags(bags, out, Request(**options), **part, force=force, progress=show)
    _show(results, f"report in {out}", "")
    _open(out, opens=opens)


def _open(page: Path, *, opens: bool) -> None:
    """Open a page in the browser; without a display nothing, as one in text takes the terminal."""
    has_display = sys.platform != "linux" or {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}
    if opens and has_display:
        import webbrowser  # noqa: PLC0415 - a rare way

        webbrowser.open(page.absolute().as_uri())


def _show(results: Results, written: str, command: str) -> None:
    """Print verdict, next step, modes, fits and warnings of a model, and what was written."""
    outcome = results.outcome
    terminal.step(headline(outcome))
    if outcome.verdict.coherence:
        terminal.note(outcome.verdict.coherence)
    terminal.step(f"Next: {outcome.verdict.next_step}{f': {command}' if command else ''}")
    terminal.show_model(terminal.facts_of(results))
    if choice := outcome.identification.choice:
        terminal.note(f"method: {choice}")
    terminal.CONSOLE.print(f"{written}")


def _after(results: Results, out: Path) -> str:
    """Return what follows on a model: a law for a usable one of the arm, else the report."""
    model, report = (terminal.quoted(out / name) for name in (job.MODEL_FILE, job.REPORT_FILE))
    is_arm = tuple(results.outcome.records[0].outputs) == CHANNEL_NAMES
    is_for_a_law = is_arm and results.outcome.verdict.level <= Level.USABLE
    return f"flexarm tune {model}" if is_for_a_law else f"open {report} in a browser"
