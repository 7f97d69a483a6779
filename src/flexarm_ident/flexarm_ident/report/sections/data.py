"""Data section: records, channels, and checks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.diagnostics.excitation import excited_band_hz
from flexarm_ident.diagnostics.quality import kinds
from flexarm_ident.report.content.blocks import Check, Checks, Heading, Plots, Section, Table, Words
from flexarm_ident.report.content.wording import error_text, figures_text, short_labels
from flexarm_ident.report.plots.time_plots import input_plot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_LOOPS = {True: "closed", False: "open", None: "unknown"}
_BIASES = {
    "rest": "Offset removed from the outputs: the mean of the initial rest (of strain, the mean).",
    "first": "Offset removed from the outputs: the first sample (of strain, the mean).",
    "mean": "Offset removed from the outputs: the mean.",
    "none": "Offset removed from strain alone: the mean.",
}


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    request = outcome.request
    yield record_table(outcome)
    compensation = (
        "Coulomb compensation, where it was recorded, is subtracted from the input."
        if request.remove_compensation
        else "The input is taken as recorded, with any Coulomb compensation."
    )
    filtered = ""
    if request.cutoff_hz:
        smoothed = "Inputs and outputs are" if request.filter_input else "The outputs alone are"
        filtered = f" {smoothed} low-pass filtered at {request.cutoff_hz:g} Hz."
    yield Words(
        f"{compensation} {_BIASES[request.bias]}{filtered} Errors and plots are of the whole "
        "record, also where only its first part is fitted."
    )
    yield _channels(outcome)
    yield Heading("Data checks")
    yield _checks(outcome)
    yield Heading("Inputs of the first record")
    yield _inputs(outcome)


SECTION = Section(10, "Data", _build)


def record_table(outcome: Outcome) -> Table:
    """Return the records with their size, fitted part and mean error."""
    names = short_labels(outcome.records)
    rows = tuple(
        (
            names[record.label],
            str(samples),
            f"{1.0 / record.dt_s:.6g}",
            f"{samples * record.dt_s:.1f}",
            f"{fitted * record.dt_s:.1f}",
            _LOOPS[record.closed_loop],
            error_text(dmv.mean),
        )
        for record, samples, fitted, dmv in zip(
            outcome.records, outcome.samples, outcome.fitted, outcome.dmv, strict=True
        )
    )
    header = ("Record", "Samples", "Rate, Hz", "Length, s", "Fitted, s", "Loop", "Mean δ")
    return Table("records", "Records", header, rows)


def _channels(outcome: Outcome) -> Table:
    """Return inputs and outputs with units, ranges and excited band, after preprocessing."""
    first = outcome.records[0]
    rows = []
    for role, names, values in (
        ("input", first.inputs, np.vstack([record.u for record in outcome.records])),
        ("output", first.outputs, np.vstack([record.y for record in outcome.records])),
    ):
        for name, x in zip(names, values.T, strict=True):
            words, unit = label_and_unit(name)
            low_hz, high_hz, share = excited_band_hz(x, first.dt_s)
            # The band of an input is the range in which a model is reliable.
            band = f"{low_hz:.3g} to {high_hz:.3g} ({100.0 * share:.0f} %)"
            figures = (x.min(), x.max(), np.sqrt(np.mean(x**2)))
            rows.append(
                (
                    *(words, role, unit or "-"),
                    *(f"{figure:.3f}" for figure in figures),
                    band if role == "input" else "",
                )
            )
    header = ("Channel", "Role", "Unit", "Lowest", "Highest", "RMS", "Excited, Hz")
    return Table("channels", "Channels", header, tuple(rows))


def _checks(outcome: Outcome) -> Checks:
    found: dict[str, list[DataWarning]] = {}
    for warning in outcome.identification.data_warnings:
        found.setdefault(warning.code, []).append(warning)
    checks = (
        Check(
            kind.title,
            tuple((_place(each), figures_text(each.figures)) for each in found.get(code, [])),
        )
        for code, kind in kinds().items()
    )
    return Checks(tuple(checks))


def _place(warning: DataWarning) -> str:
    """Return record and channel of a finding, whose sentence stands at the top of the report."""
    return ", ".join(filter(None, (warning.record, warning.channel))) or "all records"


def _inputs(outcome: Outcome) -> Plots:
    record = outcome.records[0]
    return Plots(
        tuple(
            (label_and_unit(name)[0], input_plot(record.times_s, values, name))
            for name, values in zip(record.inputs, record.u.T, strict=True)
        ),
        wide=True,
    )
