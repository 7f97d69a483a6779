"""Comparison: several models or bags in one page, each model on each record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_core.labels import counted, label_and_unit
from flexarm_core.outputs import require_place
from flexarm_ident.diagnostics.verdict import fit_text
from flexarm_ident.fitting.validation import validate_dmv
from flexarm_ident.friction.dry_friction import load_friction
from flexarm_ident.friction.first_motion import validate_with_friction
from flexarm_ident.job import MODEL_FILE, read_record, whole
from flexarm_ident.models.files import FORMATS, load_model
from flexarm_ident.models.modes import frequency_and_damping, frequency_grid
from flexarm_ident.records.naming import short_names
from flexarm_ident.records.span import EVERYTHING, Span
from flexarm_ident.report.content.blocks import Plots, Table, Words
from flexarm_ident.report.content.match_gallery import RECORDS_SHOWN, near_rows
from flexarm_ident.report.page import render_page
from flexarm_ident.report.plots.frequency_plot import COMPARED, frequency_plot
from flexarm_ident.report.plots.time_plots import overlay_plot
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    import control

    from flexarm_core.arrays import Progress
    from flexarm_ident.fitting.validation import Dmv
    from flexarm_ident.friction.dry_friction import DryFriction
    from flexarm_ident.job import Chosen
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.report.content.blocks import Block
    from flexarm_ident.workflow.request import Request

_LIGHT_DAMPING = 0.5
# Modes of two models within this ratio of frequencies stand in one row.
_SAME_MODE = 1.35
# Without a record, the lowest frequency of a response over the sampling frequency.
_LOWEST = 1e-3


@dataclass(frozen=True, eq=False)
class Compared:
    """A model that is compared with others.

    Attributes
    ----------
    name : str
        Short name of its file or bag.
    model : control.StateSpace
        The model.
    friction : DryFriction or None
        Dry friction at its inputs.
    verdict : str
        Verdict of the identification from a bag; empty for a model of a file.
    record : IoData or None
        The preprocessed record that it is of.
    """

    name: str
    model: control.StateSpace
    friction: DryFriction | None
    verdict: str = ""
    record: IoData | None = None

    def on(self, record: IoData) -> Dmv | None:
        """Return its simulation of a record; None where channels or period differ."""
        names = (*record.inputs, *record.outputs)
        if (*self.model.input_labels, *self.model.output_labels) != names:
            return None
        try:
            if self.friction is None:
                return validate_dmv(self.model, record)
            return validate_with_friction(self.model, self.friction, record)
        except IdentificationError:
            return None


def compare_files(
    paths: Sequence[Path],
    file: Path,
    request: Request,
    *,
    channels: Chosen = None,
    span: Span = EVERYTHING,
    force: bool = False,
    progress: Progress = lambda _stage, _fraction: None,
) -> list[str]:
    """Compare models and bags, and write the page.

    A bag gives a model, by an identification of its own, and a record on which all models are
    tried. A file of `save_model`, or a folder with a `model.yaml`, gives a model.

    Parameters
    ----------
    paths : sequence of Path
        Models and bags, two or more.
    file : Path
        HTML file.
    request : Request
        Options of the identifications.
    channels, span, force, progress
        As in `job.identify_bags`.

    Returns
    -------
    list of str
        The result in sentences.

    Raises
    ------
    IdentificationError
        If a bag does not allow an identification.
    ModelFileError
        If a model cannot be read.
    OutputError
        If the file cannot be written, or is somebody else's; found before the work.
    """
    require_place([file], force=force)
    names = short_names([str(path) for path in paths])
    found = []
    for number, path in enumerate(paths):
        report = whole(_part_of(progress, number, len(paths)))
        name = names[str(path)]
        model = _model_of(name, path)
        if model is None:
            report("reading", 0.0)
            record = read_record(path, request, channels, span)
            model = _identified(name, record, request, report)
        found.append(model)
    words, text = comparison_page(found)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return words


def comparison_page(found: Sequence[Compared]) -> tuple[list[str], str]:
    """Compare models, two or more, on the records that they are of.

    Returns
    -------
    words : list of str
        The result in sentences.
    page : str
        The page, with these at its top.
    """
    trials = _trials(found)
    words = _words(found, trials)
    parts: dict[str, list[Block]] = {"Models": list(_models(found))}
    if trials:
        parts["Fit"] = list(_fits(found, trials))
    parts["Modes"] = list(_modes(found))
    parts["Frequency response"] = list(_responses(found))
    if trials:
        parts["Simulation"] = list(_matches(found, trials))
    title = f"Comparison of {', '.join(each.name for each in found)}"
    return words, render_page(title, words, parts)


_Trials = list[tuple["IoData", str, list["Dmv | None"]]]


def _part_of(progress: Progress, number: int, count: int) -> Progress:
    def report(stage: str, fraction: float) -> None:
        progress(stage, (number + fraction) / count)

    return report


def _model_of(name: str, path: Path) -> Compared | None:
    """Return the model of a file or a folder; None for a bag."""
    model_file = path / MODEL_FILE if (path / MODEL_FILE).is_file() else path
    if model_file.suffix in FORMATS and model_file.is_file():
        return Compared(name, load_model(model_file), load_friction(model_file))
    return None


def _identified(name: str, record: Source, request: Request, report: Progress) -> Compared:
    outcome = run([record], request, progress=report)
    # Of a record that came in parts, the longest.
    record = max(outcome.records, key=len)
    return Compared(name, outcome.model, outcome.friction, str(outcome.verdict.level), record)


def _trials(found: Sequence[Compared]) -> _Trials:
    """Return each record with the name of its own model, and all models' simulations of it."""
    return [
        (each.record, each.name, [other.on(each.record) for other in found])
        for each in found
        if each.record is not None
    ]


def _words(found: Sequence[Compared], trials: _Trials) -> list[str]:
    on = counted(len(trials), "record") if trials else "no record: name a bag to try them on"
    lines = [f"{counted(len(found), 'model')} on {on}."]
    for _, name, simulated in trials:
        errors = {
            each.name: dmv.mean
            for each, dmv in zip(found, simulated, strict=True)
            if dmv is not None and np.isfinite(dmv.mean)
        }
        if len(errors) > 1:
            best = min(errors, key=lambda each: errors[each])
            worst = max(errors, key=lambda each: errors[each])
            lines.append(
                f"On {name}, {best} has the highest fit, {fit_text(errors[best])}, and {worst} the "
                f"lowest, {fit_text(errors[worst])}."
            )
    return lines


def _models(found: Sequence[Compared]) -> Iterator[Block]:
    rows = tuple(
        (
            each.name,
            each.verdict or "-",
            str(each.model.nstates),
            "yes" if each.friction is not None else "no",
            f"{1.0 / each.model.dt:.6g}",
        )
        for each in found
    )
    header = ("Model", "Verdict", "States", "Friction", "Rate, Hz")
    yield Table("models", "Models", header, rows)
    if not all(each.verdict for each in found):
        yield Words("A model of a file has no verdict here: the report of its identification has.")


def _fits(found: Sequence[Compared], trials: _Trials) -> Iterator[Block]:
    rows = tuple(
        (each.name, *("-" if dmv is None else fit_text(dmv.mean) for dmv in column))
        for each, column in zip(
            found, zip(*(simulated for _, _, simulated in trials), strict=True), strict=True
        )
    )
    header = ("Model", *(f"On {name}" for _, name, _ in trials))
    yield Table("trials", "Mean fit of each model on each record", header, rows)
    yield Words(
        "Each model is driven by the measured input of each record and nothing else; the initial "
        "state is fitted. The fit is 100 % of a perfect model and 0 % of the mean. A model that is "
        "much better on its own record than on the others is overfitted, or the arm has "
        "changed. A dash stands where channels or period differ."
    )


def _modes(found: Sequence[Compared]) -> Iterator[Block]:
    columns = [_light_modes(each.model) for each in found]
    taken = [set[int]() for _ in columns]
    rows = []
    for number, modes in enumerate(columns):
        for place, (frequency_hz, _) in enumerate(modes):
            if place in taken[number]:
                continue
            cells = []
            for other, each in enumerate(columns):
                near = _nearest(each, frequency_hz, taken[other])
                cells.append("-" if near is None else "{:.3f} ({:.3f})".format(*each[near]))
                if near is not None:
                    taken[other].add(near)
            rows.append((frequency_hz, cells))
    rows.sort(key=lambda row: row[0])
    cells_by_number = tuple((str(i), *cells) for i, (_, cells) in enumerate(rows, start=1))
    header = ("Mode", *(each.name for each in found))
    yield Table("compared", "Modes of the models", header, cells_by_number)
    yield Words(
        f"Frequency in hertz and damping ratio of the modes that are damped by less than "
        f"{_LIGHT_DAMPING}; those of about the same frequency stand in one row."
    )


def _light_modes(model: control.StateSpace) -> list[tuple[float, float]]:
    pairs = [
        frequency_and_damping(complex(each), model.dt)
        for each in np.linalg.eigvals(model.A)
        if each.imag > 0.0
    ]
    return sorted(pair for pair in pairs if pair[1] < _LIGHT_DAMPING)


def _nearest(
    modes: Sequence[tuple[float, float]], frequency_hz: float, taken: set[int]
) -> int | None:
    free = [place for place in range(len(modes)) if place not in taken]
    distance = {place: abs(np.log(modes[place][0] / frequency_hz)) for place in free}
    best = min(free, key=lambda place: distance[place], default=None)
    return best if best is not None and distance[best] < np.log(_SAME_MODE) else None


def _responses(found: Sequence[Compared]) -> Iterator[Block]:
    first = found[0].model
    alike = {
        each.name: each.model
        for each in found
        if each.model.input_labels == first.input_labels
        and each.model.output_labels == first.output_labels
    }
    shown = dict(list(alike.items())[:COMPARED])
    fastest = min(shown.values(), key=lambda model: float(model.dt))
    grid_hz = frequency_grid(fastest, _LOWEST / fastest.dt)
    words = f"From {label_and_unit(first.input_labels[0])[0]} to each output."
    if len(shown) < len(found):
        words += f" {counted(len(shown), 'model')} of the same channels as {found[0].name}."
    yield Words(words)
    yield Plots(
        tuple(
            (label_and_unit(name)[0], frequency_plot(shown, output, frequencies_hz=grid_hz))
            for output, name in enumerate(first.output_labels)
        )
    )


def _matches(found: Sequence[Compared], trials: _Trials) -> Iterator[Block]:
    for record, name, simulated in trials[:RECORDS_SHOWN]:
        curves = {
            each.name: dmv.y for each, dmv in zip(found, simulated, strict=True) if dmv is not None
        }
        shown = dict(list(curves.items())[: COMPARED - 1])
        near = near_rows(record)
        seconds = (near.stop - near.start) * record.dt_s
        yield Words(f"Record {name}, the {seconds:.3g} s with the largest changes.")
        yield Plots(
            tuple(
                (
                    label_and_unit(output)[0],
                    overlay_plot(
                        record.times_s,
                        record.y_usable[:, number],
                        {label: y[:, number] for label, y in shown.items()},
                        output,
                        near=near,
                    ),
                )
                for number, output in enumerate(record.outputs)
            )
        )
