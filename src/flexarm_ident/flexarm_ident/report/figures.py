"""The plots of a report, in groups with their captions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.content import error_text, mode_scatter_words, short_labels
from flexarm_ident.report.plots.frequency_plot import frequency_grid, frequency_plot
from flexarm_ident.report.plots.order_plots import singular_value_plot, stabilisation_plot
from flexarm_ident.report.plots.pole_plots import damping_plot, pole_plot
from flexarm_ident.report.plots.time_plots import CURVE_POINTS, match_plot

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.workflow.workflow import Outcome

_RECORDS_SHOWN = 3
# Keeps a report below 1.5 MB whatever its number of channels.
_ALL_POINTS = 60_000
_FEWEST_POINTS = 200
_RESPONSES_SHOWN = 12


@dataclass(frozen=True)
class Gallery:
    """Plots of one kind: what they are, and caption and SVG of each."""

    title: str
    words: str
    plots: tuple[tuple[str, str], ...]


def galleries(outcome: Outcome) -> list[Gallery]:
    """Return the plots of both validations and of the frequency response."""
    shown = outcome.records[:_RECORDS_SHOWN]
    labels = short_labels(outcome.records)
    runs = len(shown) + (outcome.sfv is not None)
    curves = 2 * runs * shown[0].y.shape[1]
    points = min(CURVE_POINTS, max(_FEWEST_POINTS, _ALL_POINTS // curves))
    galleries = []
    for i, record in enumerate(shown):
        words = (
            f"{labels[record.label]}: the model is driven by the measured input and nothing else."
        )
        if i == 0 and len(outcome.records) > len(shown):
            words += f" The first {len(shown)} of {len(outcome.records)} records are shown."
        simulated, delta = outcome.dmv[i].y, outcome.dmv[i].delta
        matches = _matches(record, simulated, delta, outcome.fitted[i], points)
        galleries.append(Gallery("Data matching", words, matches))
    if outcome.sfv is not None:
        gains = outcome.sfv.gains
        words = (
            f"{labels[shown[0].label]}: the model follows the recorded set-point under the law of "
            f"the experiment, kp = {gains.kp:.3f}, kd = {gains.kd:.3f}, ksg = {abs(gains.ksg):.3f}."
        )
        sfv = outcome.sfv
        matches = _matches(shown[0], sfv.y, sfv.delta, outcome.fitted[0], points)
        galleries.append(Gallery("Set-point following", words, matches))
    return [*galleries, *_frequency_galleries(outcome)]


def _matches(
    record: IoData, simulated: FloatArray, delta: FloatArray, fitted: int, points: int
) -> tuple[tuple[str, str], ...]:
    time_s = np.linspace(0.0, (len(record) - 1) * record.dt_s, len(record))
    fitted = min(fitted, len(record))
    return tuple(
        (
            f"{label_and_unit(name)[0]}, δ = {error_text(delta[i])}",
            match_plot(
                time_s,
                record.y_usable[:, i],
                simulated[:, i],
                name,
                fitted_s=fitted * record.dt_s,
                points=points,
            ),
        )
        for i, name in enumerate(record.outputs)
    )


def _frequency_galleries(outcome: Outcome) -> list[Gallery]:
    record = max(outcome.records, key=len)
    full, reduced = outcome.identification.model, outcome.reduction and outcome.reduction.model
    grid_hz = frequency_grid(full, 1.0 / (len(record) * record.dt_s))
    known = outcome.identification.response_uncertainty(grid_hz)
    shown = record.inputs[: max(1, _RESPONSES_SHOWN // len(record.outputs))]
    band = _band_words(outcome, known is not None)
    galleries = []
    for j, source in enumerate(shown):
        responses = tuple(
            (
                label_and_unit(name)[0],
                frequency_plot(
                    full,
                    reduced,
                    i,
                    j,
                    frequencies_hz=grid_hz,
                    deviation=None if known is None else known.deviation[:, i, j],
                    known_modes_hz=outcome.request.known_modes_hz,
                ),
            )
            for i, name in enumerate(record.outputs)
        )
        words = f"From {label_and_unit(source)[0]} to each output."
        if j == 0:
            words += f" {band}"
            if len(shown) < len(record.inputs):
                words += f" The first {len(shown)} of {len(record.inputs)} inputs are shown."
        galleries.append(Gallery("Frequency response", words, responses))
    return galleries


def _band_words(outcome: Outcome, known: bool) -> str:  # noqa: FBT001 - the one question
    if known:
        return (
            "The band is two standard deviations to both sides of the full model's gain, from "
            "leaving out one tenth of the data at a time."
        )
    return f"There is no band. {mode_scatter_words(outcome)}"


def pole_plots(outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Return caption and plot of the poles in both views."""
    modes, deviations = outcome.modes, outcome.identification.mode_uncertainty
    return (
        ("Plane of z, with the unit circle", pole_plot(modes, outcome.model.dt)),
        ("Damping over frequency", damping_plot(modes, deviations)),
    )


def order_plots(outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Return caption and plot of what the order was chosen by."""
    found, known_hz = outcome.identification, outcome.request.known_modes_hz
    return (
        ("Singular values", singular_value_plot(found.singular_values, found.order)),
        (
            "Stabilisation diagram",
            stabilisation_plot(found.diagram, known_modes_hz=known_hz, order=found.order),
        ),
    )
