"""What a report says of the data: records, channels, and what was checked."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.diagnostics.quality import excited_band_hz
from flexarm_ident.report.content import Table, error_text, short_labels
from flexarm_ident.report.plots.time_plots import input_plot

if TYPE_CHECKING:
    from flexarm_ident.records.iodata import DataWarning
    from flexarm_ident.workflow.workflow import Outcome

_LOOPS = {True: "closed", False: "open", None: "unknown"}
_CHECKS = {
    "lost_samples": "Lost samples",
    "restarted": "Restarts",
    "clock_jitter": "Clock jitter",
    "feedback": "Closed loop",
    "saturation": "Saturation",
    "dead_sensor": "Dead sensor",
    "constant_channel": "Constant channel",
    "duplicated_channel": "Duplicated channel",
    "offset": "Offset",
    "excitation_band": "Excited band",
    "input_condition": "Richness of the input",
    "too_short": "Length",
}


class Check(NamedTuple):
    """One thing that was looked for: its name, and what was found with the figures of it."""

    name: str
    findings: tuple[tuple[str, str], ...]


def record_table(outcome: Outcome) -> Table:
    """Return the records with their size, fitted part and mean error."""
    names = short_labels(outcome.records)
    rows = []
    for record, samples, fitted, dmv in zip(
        outcome.records, outcome.samples, outcome.fitted, outcome.dmv, strict=True
    ):
        cells = (
            names[record.label],
            str(samples),
            f"{1.0 / record.dt_s:.6g}",
            f"{samples * record.dt_s:.1f}",
            f"{fitted * record.dt_s:.1f}",
            _LOOPS[record.closed_loop],
            error_text(dmv.mean),
        )
        rows.append(cells)
    header = ("Record", "Samples", "Rate, Hz", "Length, s", "Fitted, s", "Loop", "Mean δ")
    return Table(header, tuple(rows))


def channel_table(outcome: Outcome) -> Table:
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
            # Only of an input a band says what a model can be trusted in.
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
    return Table(header, tuple(rows))


def checks(outcome: Outcome) -> list[Check]:
    """Return what was looked for in the data, with what was found."""
    found: dict[str, list[DataWarning]] = {}
    for warning in outcome.identification.data_warnings:
        found.setdefault(warning.name, []).append(warning)
    titles = _CHECKS | {name: check_title(name) for name in found if name not in _CHECKS}
    return [
        Check(
            title,
            tuple((_shortened(outcome, each.text), _figures(each)) for each in found.get(name, [])),
        )
        for name, title in titles.items()
    ]


def check_title(name: str) -> str:
    """Return a data warning's name in words."""
    return _CHECKS.get(name, name.replace("_", " ").capitalize())


def headline(outcome: Outcome) -> str:
    """Return the names of what was found in the data, each once; empty for good data."""
    names = Counter(warning.name for warning in outcome.identification.data_warnings)
    words = [
        check_title(name).lower() + (f" ({count} times)" if count > 1 else "")
        for name, count in names.items()
    ]
    return ", ".join(words)


def remarks(outcome: Outcome) -> list[str]:
    """Return the warnings that are not of the checks."""
    checked = {warning.text for warning in outcome.identification.data_warnings}
    return [_shortened(outcome, text) for text in outcome.warnings if text not in checked]


def input_plots(outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Return caption and plot of each input of the first record."""
    record = outcome.records[0]
    time_s = np.linspace(0.0, (len(record) - 1) * record.dt_s, len(record))
    return tuple(
        (label_and_unit(name)[0], input_plot(time_s, values, name))
        for name, values in zip(record.inputs, record.u.T, strict=True)
    )


def _shortened(outcome: Outcome, text: str) -> str:
    for label, short in short_labels(outcome.records).items():
        text = text.replace(label, short)
    return text


def _figures(warning: DataWarning) -> str:
    words = []
    for key, value in warning.figures.items():
        name, unit = label_and_unit(key)
        words.append(" ".join(filter(None, (name, f"{value:.4g}", unit))))
    return ", ".join(words)
