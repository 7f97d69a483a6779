"""Servo for a record or a model of any plant: the part of the verb design that needs no arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.quantity import FREQUENCY_HZ, TIME_S, FiniteRange, Quantity
from flexarm_bringup.console.verb_group import together
from flexarm_bringup.verbs.offline.channel_options import (
    channel_options,
    taken_part,
)
from flexarm_core.errors import SettingError
from flexarm_core.outputs import require_place, write_facts

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_control.servo.job import ServoDesign, ServoRequest, Source
    from flexarm_ident.records.source import Source as Record

CONTROLLER_FILE, C_FILE = "controller.yaml", "controller.h"
_SUMMARY_FILE, _REPORT_FILE = "summary.json", "report.html"
_FILES = (CONTROLLER_FILE, C_FILE, _SUMMARY_FILE, _REPORT_FILE)
_MODELS_FOLDER = "models"
_MODEL_FILES = frozenset({".yaml", ".yml", ".json"})


class _Bandwidth(Quantity):
    """Frequency, or the word auto."""

    name = "bandwidth"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401 - as click has it
        """Return the frequency in Hz, or None for auto."""
        return None if value in {None, "auto"} else super().convert(value, param, ctx)


servo_options = together(
    channel_options,
    click.option("--track", multiple=True, metavar="OUTPUT", help="Tracked output; repeat."),
    click.option(
        "--limit",
        "limits",
        multiple=True,
        metavar="INPUT=VALUE",
        help="Largest command; else that of the record; repeat.",
    ),
    click.option(
        "--bandwidth",
        "bandwidth_hz",
        type=_Bandwidth(FREQUENCY_HZ, 1e-6),
        metavar="FREQUENCY|auto",
        help="Hz; auto, the default, raises it until the margin is used up.",
    ),
    click.option(
        "--robustness",
        type=FiniteRange(0.0, 2.0),
        default=0.5,
        show_default=True,
        help="Least disk margin, for auto.",
    ),
    click.option(
        "--delay",
        "delay_s",
        type=Quantity(TIME_S, 0.0, 10.0),
        default=0.0,
        metavar="TIME",
        help="Time from a sample to its command, s, or with its unit: 0.5ms.",
    ),
)
"""Options of `run_servo`."""


def run_servo(
    paths: Sequence[Path], law: str, out: Path, options: dict[str, Any], *, force: bool
) -> None:
    """Identify what is a record, design a servo, and write it with its report.

    Parameters
    ----------
    paths : sequence of Path
        Model files, bags or CSV files of one rig.
    law : str
        servo or hinf.
    out : Path
        Folder of the results.
    options : dict
        Those of `servo_options`.
    force : bool
        Files of others are replaced too.

    Raises
    ------
    FlexarmError
        When a record has no model, or a model no such servo.
    """
    # It loads python-control.
    from flexarm_control.servo.job import design_servo  # noqa: PLC0415 - not for the help

    require_place([out / name for name in _FILES], force=force)
    request = _request(law, options)
    sources = _sources(paths, out, options, request, force=force)
    with terminal.busy(
        f"designing {request.law} on {len(sources)} model{'s' * (len(sources) != 1)}"
    ):
        design = design_servo(sources, request)
    write_servo(design, [source.name for source in sources], out)


def write_servo(design: ServoDesign, models: list[str], out: Path) -> None:
    """Write a design with its report into a folder, and print it.

    Parameters
    ----------
    design : ServoDesign
        The design.
    models : list of str
        Names of its models.
    out : Path
        Folder, which is made.
    """
    from flexarm_control.servo.c_code import c_controller  # noqa: PLC0415 - not for the help
    from flexarm_control.servo.files import save_controller  # noqa: PLC0415
    from flexarm_control.servo.report import report, summary, summary_lines  # noqa: PLC0415

    out.mkdir(parents=True, exist_ok=True)
    save_controller(out / CONTROLLER_FILE, design.gains, {"models": models})
    (out / C_FILE).write_text(c_controller(design.gains), "utf-8")
    write_facts(out / _SUMMARY_FILE, summary(design))
    (out / _REPORT_FILE).write_text(report(design), "utf-8")
    for line in summary_lines(design):
        terminal.CONSOLE.print(f"  {line}")
    terminal.step(f"Controller: {out / CONTROLLER_FILE}. Report: {out / _REPORT_FILE}")


def _request(law: str, options: dict[str, Any]) -> ServoRequest:
    from flexarm_control.servo.job import ServoRequest  # noqa: PLC0415 - not for the help

    limits = {}
    for text in options.pop("limits"):
        name, sign, value = text.rpartition("=")
        try:
            limits[name] = float(value)
        except ValueError:
            sign = ""
        if not (sign and name):
            raise click.UsageError(f"--limit {text}: write INPUT=VALUE, such as torque=3")
    keys = ("bandwidth_hz", "robustness", "delay_s")
    figures = {key: options.pop(key) for key in keys}
    return ServoRequest(options.pop("track"), limits, **figures, law=law)


def _sources(
    paths: Sequence[Path],
    out: Path,
    options: dict[str, Any],
    request: ServoRequest,
    *,
    force: bool,
) -> list[Source]:
    """Return the models, in the order of the paths; a record is identified."""
    for path in paths:
        if not path.exists():
            raise SettingError(f"{path}: no such file: name a record, or a model from identify")
    records = [path for path in paths if not _is_model(path)]
    if not records:
        if options["inputs"] or options["outputs"]:
            raise click.UsageError("--input and --output name signals of a record, not of a model")
        return [_read(path) for path in paths]
    _guess(records, options)
    part = taken_part(records, options)
    found: dict[Path, Source] = {path: _read(path) for path in paths if _is_model(path)}
    for path in records:
        found[path] = _identified(path, out, part, request, force=force)
    return [found[path] for path in paths]


def _guess(records: Sequence[Path], options: dict[str, Any]) -> None:
    """Take inputs and outputs of a CSV file by their names, where they were not said."""
    from flexarm_ident.importing.csv_columns import guessed_columns  # noqa: PLC0415

    if (options["inputs"] and options["outputs"]) or records[0].is_dir():
        return
    inputs, outputs = guessed_columns(
        records[0], options["inputs"], options["outputs"], options["times"]
    )
    options.update(inputs=inputs, outputs=outputs)
    terminal.note(
        f"{records[0]}: inputs {', '.join(inputs)}, outputs {', '.join(outputs)}, by their names; "
        "--input and --output say others"
    )


def _is_model(path: Path) -> bool:
    return path.suffix.lower() in _MODEL_FILES or (path / "model.yaml").is_file()


def _read(path: Path) -> Source:
    from flexarm_control.servo.job import Source  # noqa: PLC0415 - not for the help
    from flexarm_ident.friction.dry_friction import load_friction  # noqa: PLC0415
    from flexarm_ident.models.files import load_model, load_parameters  # noqa: PLC0415

    file = path / "model.yaml" if path.is_dir() else path
    facts = {key.rpartition(".")[2]: value for key, value in load_parameters(file).items()}
    return Source(str(path), load_model(file), load_friction(file), facts=facts)


def _identified(
    path: Path, out: Path, part: dict[str, Any], request: ServoRequest, *, force: bool
) -> Source:
    from flexarm_control.servo.job import Source  # noqa: PLC0415 - not for the help
    from flexarm_ident import job  # noqa: PLC0415
    from flexarm_ident.workflow.request import Request  # noqa: PLC0415

    def read(*which: Any) -> Record:  # noqa: ANN401 - as the job has it
        record = job.read_record(*which)
        # Before the minute that an identification takes.
        request.tracked(record.inputs, record.outputs)
        return record

    folder = out / _MODELS_FOLDER / job.model_name(path)
    with terminal.progress() as show:
        results = job.identify_bags(
            (path,), folder, Request(), **part, force=force, read=read, progress=show
        )
    outcome = results.outcome
    terminal.step(f"{path}: {outcome.verdict}")
    return Source(str(path), outcome.model, outcome.friction, outcome.records[0])
