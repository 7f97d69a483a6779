"""Residuals section: correlation of what the model leaves, in time and with the inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.fitting.residuals import LAGS
from flexarm_ident.report.content.blocks import Plots, Section, Table, Words
from flexarm_ident.report.plots.residual_plot import RESIDUAL_INPUTS, residual_plot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    record, found = outcome.records[0], outcome.residuals
    few = f" The first {RESIDUAL_INPUTS} inputs are shown."
    yield Words(
        "The residual is the measured minus the simulated output. A correlation with earlier "
        "inputs, at positive lags, shows dynamics that the model lacks; one with later inputs "
        "shows a controller. A residual that is not white is no fault of the model where the noise "
        "is not white either. One lag of a hundred leaves the bounds by chance."
        + (few if len(record.inputs) > RESIDUAL_INPUTS else "")
    )
    yield _shares(outcome)
    if outcome.spectra is not None:
        yield Words(
            "The coherent output is the share of an output's power that is coherent with the "
            "inputs, by averaged spectra of short segments. It is no grade of the model: "
            "it falls where the inputs have power at few frequencies, and where an output drifts "
            "over longer times than a segment, as an integrator does, while the fit stays high."
        )
    yield Plots(
        tuple(
            (label_and_unit(name)[0], residual_plot(found, output, name, record.inputs))
            for output, name in enumerate(record.outputs)
        )
    )


SECTION = Section(95, "Residuals", _build)


def _shares(outcome: Outcome) -> Table:
    """Return the shares of lags outside the bounds, and of the power that is coherent."""
    found, spectra = outcome.residuals, outcome.spectra
    rows = tuple(
        (
            label_and_unit(name)[0],
            f"{100.0 * (1.0 - found.is_white[output]):.0f} %",
            f"{100.0 * (1.0 - found.is_independent[output].min()):.0f} %",
            "-" if spectra is None else f"{100.0 * spectra.explained[output]:.1f} %",
        )
        for output, name in enumerate(outcome.records[0].outputs)
    )
    header = ("Output", "Not white", "With inputs", "Coherent output")
    about = f"Lags of {LAGS} outside the bounds, and power of the output coherent with the inputs"
    return Table("residuals", about, header, rows)
