"""The plots of a report, in groups with their captions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident import plots
from flexarm_ident.channels import label_and_unit
from flexarm_ident.report_content import error_text

if TYPE_CHECKING:
    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.iodata import IoData
    from flexarm_ident.workflow import Outcome

_RECORDS_SHOWN = 3
# Keeps a report below 1.5 MB whatever its number of channels.
_ALL_POINTS = 60_000
_FEWEST_POINTS = 200


@dataclass(frozen=True)
class Gallery:
    """Plots of one kind: what they are, and caption and SVG of each."""

    title: str
    words: str
    plots: tuple[tuple[str, str], ...]


def galleries(outcome: Outcome) -> list[Gallery]:
    """Return the plots of both validations and of the frequency response."""
    shown = outcome.records[:_RECORDS_SHOWN]
    runs = len(shown) + (outcome.sfv is not None)
    curves = 2 * runs * shown[0].y.shape[1]
    points = min(plots.CURVE_POINTS, max(_FEWEST_POINTS, _ALL_POINTS // curves))
    galleries = []
    for i, record in enumerate(shown):
        words = f"{record.label}: the model is driven by the measured input and nothing else."
        if i == 0 and len(outcome.records) > len(shown):
            words += f" The first {len(shown)} of {len(outcome.records)} records are shown."
        simulated, delta = outcome.dmv[i].y, outcome.dmv[i].delta
        matches = _matches(record, simulated, delta, outcome.fitted[i], points)
        galleries.append(Gallery("Data matching", words, matches))
    if outcome.sfv is not None:
        gains = outcome.sfv.gains
        words = (
            f"{shown[0].label}: the model follows the recorded set-point under the law of the "
            f"experiment, kp = {gains.kp:.3f}, kd = {gains.kd:.3f}, ksg = {abs(gains.ksg):.3f}."
        )
        sfv = outcome.sfv
        matches = _matches(shown[0], sfv.y, sfv.delta, outcome.fitted[0], points)
        galleries.append(Gallery("Set-point following", words, matches))
    galleries.append(_frequency_gallery(outcome))
    return galleries


def _matches(
    record: IoData, simulated: FloatArray, delta: FloatArray, fitted: int, points: int
) -> tuple[tuple[str, str], ...]:
    time_s = np.linspace(0.0, (len(record) - 1) * record.dt_s, len(record))
    fitted = min(fitted, len(record))
    return tuple(
        (
            f"{label_and_unit(name)[0]}, δ = {error_text(delta[i])}",
            plots.match_plot(
                time_s,
                record.y[:, i],
                simulated[:, i],
                name,
                fitted_s=fitted * record.dt_s,
                points=points,
            ),
        )
        for i, name in enumerate(record.outputs)
    )


def _frequency_gallery(outcome: Outcome) -> Gallery:
    record = max(outcome.records, key=len)
    full, reduced = outcome.identification.model, outcome.reduction and outcome.reduction.model
    grid_hz = plots.frequency_grid(full, 1.0 / (len(record) * record.dt_s))
    known = outcome.identification.response_uncertainty(grid_hz)
    responses = tuple(
        (
            label_and_unit(name)[0],
            plots.frequency_plot(
                full,
                reduced,
                i,
                frequencies_hz=grid_hz,
                deviation=None if known is None else known.deviation[:, i, 0],
                known_modes_hz=outcome.request.known_modes_hz,
            ),
        )
        for i, name in enumerate(record.outputs)
    )
    words = f"From {label_and_unit(record.inputs[0])[0]} to each output."
    if known is not None:
        words += (
            " The band is two standard deviations to both sides of the full model's gain, from "
            "leaving out one tenth of the data at a time."
        )
    return Gallery("Frequency response", words, responses)
