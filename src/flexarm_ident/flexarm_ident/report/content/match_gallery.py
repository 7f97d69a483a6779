"""Gallery of measured and simulated outputs over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.content.blocks import Plots
from flexarm_ident.report.content.wording import error_text
from flexarm_ident.report.plots.time_plots import CURVE_POINTS, match_plot

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.workflow.outcome import Outcome

RECORDS_SHOWN = 3
# Keeps a report below 1.5 MB whatever its number of channels.
_ALL_POINTS = 60_000
_FEWEST_POINTS = 200


def match_gallery(outcome: Outcome, number: int, simulated: FloatArray, delta: FloatArray) -> Plots:
    """Plot every output of a record over the measured one.

    Parameters
    ----------
    outcome : Outcome
        The identification.
    number : int
        Number of the record, from 0.
    simulated : ndarray, (samples, outputs)
        Simulated outputs.
    delta : ndarray, (outputs,)
        Their errors (2-25).
    """
    record = outcome.records[number]
    fitted = min(outcome.fitted[number], len(record))
    galleries = min(RECORDS_SHOWN, len(outcome.records)) + (outcome.sfv is not None)
    curves = 2 * galleries * record.y.shape[1]
    points = min(CURVE_POINTS, max(_FEWEST_POINTS, _ALL_POINTS // curves))
    return Plots(
        tuple(
            (
                f"{label_and_unit(name)[0]}, δ = {error_text(delta[i])}",
                match_plot(
                    record.times_s,
                    record.y_usable[:, i],
                    simulated[:, i],
                    name,
                    fitted_s=fitted * record.dt_s,
                    points=points,
                ),
            )
            for i, name in enumerate(record.outputs)
        )
    )
