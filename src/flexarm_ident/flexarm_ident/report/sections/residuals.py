"""Residuals section: correlation of what the model leaves, in time and with the inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.fitting.residuals import LAGS
from flexarm_ident.report.content.blocks import Plots, Section, Table, Words
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_ident.fitting.residuals import Residuals
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_LOOKS = (marks.SOLID, marks.DASHED, marks.DOTTED)
RESIDUAL_INPUTS = len(_LOOKS)
"""Inputs that a plot shows."""
_SIZE = "height:6.5rem"
_CHANCE = "99 % confidence"


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    record, found = outcome.records[0], outcome.residuals
    few = f" The first {RESIDUAL_INPUTS} inputs are shown."
    yield Words(
        "The residual is the measured minus the simulated output. A correlation with earlier "
        "inputs, at positive lags, shows dynamics that the model lacks; one with later inputs "
        "shows a controller. A residual that is not white is not a fault of the model where the "
        "noise is not white either. One lag in a hundred exceeds the bounds by chance."
        + (few if len(record.inputs) > RESIDUAL_INPUTS else "")
    )
    yield _shares(outcome)
    if outcome.spectra is not None:
        yield Words(
            "The coherent output is the share of an output's power that is coherent with the "
            "inputs, by averaged spectra of short segments. It is not a grade of the model: "
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
    header = ("Output", "Autocorrelation", "Cross-correlation", "Coherent output")
    about = f"Lags of {LAGS} outside the bounds, and power of the output coherent with the inputs"
    return Table("residuals", about, header, rows)


def residual_plot(found: Residuals, output: int, name: str, inputs: Sequence[str]) -> str:
    """Plot the correlations of one output's residual; the bounds are shaded.

    Parameters
    ----------
    found : Residuals
        The correlations.
    output : int
        Number of the output, from 0.
    name : str
        Its name.
    inputs : sequence of str
        Names of the inputs; the first three are shown.
    """
    shown = list(zip(range(len(inputs)), inputs, _LOOKS, strict=False))
    words = f"{label_and_unit(name)[0]}: correlation of the residual"
    own_ends, ends = [0.0, found.own_lags[-1]], [found.lags[0], found.lags[-1]]
    own_bound = found.own_bound
    bound = max(found.cross_bound[output, number] for number, _, _ in shown)
    own = [
        marks.between(own_ends, -own_bound, own_bound, marks.SHADE, _CHANCE),
        marks.line(found.own_lags, found.own[:, output], marks.SOLID, "with itself"),
    ]
    cross = [marks.between(ends, -bound, bound, marks.SHADE, _CHANCE)] + [
        marks.line(
            found.lags,
            found.cross[:, output, number],
            look,
            f"with {label_and_unit(source)[0]}",
        )
        for number, source, look in shown
    ]
    return chart(
        *(
            View(
                words,
                Axis("lag, samples", float(limits[0]), float(limits[1])),
                [Panel(Axis.around(label, [each.y for each in panel]), panel, _SIZE)],
            )
            for label, limits, panel in (
                ("with inputs", ends, cross),
                ("with itself", own_ends, own),
            )
        )
    )
