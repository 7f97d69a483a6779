"""Gallery of measured and simulated outputs over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.labels import label_and_unit
from flexarm_ident.report.content.blocks import Plots
from flexarm_ident.report.content.wording import error_text
from flexarm_ident.report.plots.time_plots import (
    ARM_UNITS,
    CURVE_POINTS,
    Match,
    liveliest,
    match_plot,
    near_plot,
)

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.workflow.outcome import Outcome

RECORDS_SHOWN = 3
# Keeps a report below 1.5 MB whatever its number of channels.
_ALL_POINTS = 60_000
_FEWEST_POINTS = 200
# A part of the record that shows single vibrations: a twelfth, within these samples.
_PART, _FEWEST_NEAR, _MOST_NEAR = 12, 200, 900


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
        Their relative errors about the mean.
    """
    record = outcome.records[number]
    fitted = min(outcome.fitted[number], len(record))
    galleries = min(RECORDS_SHOWN, len(outcome.records)) + (outcome.sfv is not None)
    curves = 2 * galleries * record.y.shape[1]
    near = near_rows(record)
    points = min(CURVE_POINTS, max(_FEWEST_POINTS, _ALL_POINTS // curves))
    return Plots(
        tuple(
            (
                f"{label_and_unit(name)[0]}, δ = {error_text(delta[i])}",
                match_plot(
                    _match(record, i, simulated),
                    fitted_s=fitted * record.dt_s,
                    near=near,
                    points=points,
                ),
            )
            for i, name in enumerate(record.outputs)
        ),
        wide=True,
    )


def first_match(outcome: Outcome) -> Plots:
    """Plot a lively part of the first record: the output that has the first error."""
    record, dmv = outcome.records[0], outcome.dmv[0]
    number = int(np.flatnonzero(~np.isnan(dmv.error))[0])
    near = near_rows(record)
    plot = near_plot(_match(record, number, dmv.y), near)
    seconds = (near.stop - near.start) * record.dt_s
    words = label_and_unit(record.outputs[number])[0]
    return Plots(((f"{words}, {seconds:.3g} s of the record", plot),))


def near_rows(record: IoData) -> slice:
    """Return the rows of a record that show single vibrations."""
    samples = min(max(len(record) // _PART, _FEWEST_NEAR), _MOST_NEAR)
    return liveliest(record.y, samples)


def _match(record: IoData, number: int, simulated: FloatArray) -> Match:
    name = record.outputs[number]
    # Another rig's volts stand for something else.
    second = ARM_UNITS.get(name) if record.outputs == CHANNEL_NAMES else None
    return Match(name, record.times_s, record.y_usable[:, number], simulated[:, number], second)
