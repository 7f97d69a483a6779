"""Frequency response plot, with a band of standard deviations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.fitting.residuals import CHANCE
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.diagnostics.spectra import Spectra
    from flexarm_ident.report.plots.marks import Mark

_SMALLEST_GAIN = 1e-12
_BAND_DEPTH_DB = 20.0
_PHASE_TICKS = 4
_LOOKS = (marks.SOLID, marks.DASHED, marks.DOTTED, marks.THIN)
COMPARED = len(_LOOKS)
"""Models that a plot shows."""
_MEASURED = "measured"


def frequency_plot(
    models: Mapping[str, control.StateSpace],
    output: int,
    source: int = 0,
    *,
    frequencies_hz: FloatArray,
    deviation: FloatArray | None = None,
    measured: Spectra | None = None,
    known_modes_hz: Sequence[float] = (),
) -> str:
    """Plot magnitude and phase of the response (2-4) from one input to one output.

    Parameters
    ----------
    models : mapping of str to control.StateSpace
        Discrete models with the same channels by their names in the legend, four at most.
    output, source : int
        Numbers of the output and of the input, from 0.
    frequencies_hz : ndarray, (frequencies,)
        Frequencies, see `frequency_grid`.
    deviation : ndarray, (frequencies,), optional
        Standard deviation of the first model's complex gain; the band is twice as wide.
    measured : Spectra, optional
        Nonparametric response, drawn behind the models, and the coherence.
    known_modes_hz : sequence of float
        Frequencies marked by thin lines.
    """
    first = next(iter(models.values()))
    names = first.input_labels[source], first.output_labels[output]
    low, high = (float(np.log10(end)) for end in frequencies_hz[[0, -1]])
    x = Axis("frequency, Hz", low, high, log=True)
    magnitude: list[Mark] = []
    phase: list[Mark] = []
    first_deg: FloatArray | None = None
    for (label, model), look in zip(models.items(), _LOOKS, strict=False):
        response = frequency_response(model, frequencies_hz)[:, output, source]
        # A model of a longer period ends earlier.
        response[frequencies_hz > 0.5001 / model.dt] = np.nan
        degrees = _unwrapped_deg(response)
        first_deg = degrees if first_deg is None else first_deg
        # Whole turns mean nothing: take those that bring the curves together.
        degrees -= 360.0 * np.round(np.nanmedian(degrees - first_deg) / 360.0)
        if model is first and deviation is not None:
            magnitude.append(_band(response, deviation, frequencies_hz))
        magnitude.append(marks.line(frequencies_hz, _decibels(np.abs(response)), look, label))
        phase.append(marks.line(frequencies_hz, degrees, look, label))
    below: list[Mark] = []
    if measured is not None and first_deg is not None:
        turned_deg = np.interp(measured.frequencies_hz, frequencies_hz, first_deg)
        gain, turn, *below = _measured(measured, (output, source), turned_deg, x)
        magnitude.insert(0, gain)
        phase.insert(0, turn)
    panels = [
        _panel(
            Axis.around(f"gain, {_gain_unit(*names)}", (mark.y for mark in magnitude)), magnitude
        ),
        _panel(_phase_axis(phase), phase, "height:6rem"),
    ]
    if below:
        panels.append(_panel(Axis("coherence", 0.0, 1.0, step=0.5), below, "height:3rem"))
    if known_modes_hz:
        panels = [_with_known(panel, known_modes_hz) for panel in panels]
    cause, effect = (label_and_unit(name)[0] for name in names)
    return chart(View(f"frequency response from {cause} to {effect}", x, panels))


def _band(response: ComplexArray, deviation: FloatArray, frequencies_hz: FloatArray) -> Mark:
    """Return the band of two deviations; it ends a little below the smallest gain."""
    gain = np.abs(response)
    floor = _decibels(gain).min() - _BAND_DEPTH_DB
    low, high = np.maximum(_decibels(gain + np.outer([-2.0, 2.0], deviation)), floor)
    return marks.between(frequencies_hz, low, high, marks.BAND, "±2 standard deviations")


def _measured(
    found: Spectra, channels: tuple[int, int], model_deg: FloatArray, x: Axis
) -> list[Mark]:
    """Return gain and phase where the output is coherent with the inputs, and the coherence.

    The phase takes the whole turns of the model's, (frequencies,).
    """
    output, source = channels
    at_hz, coherence = found.frequencies_hz, found.coherence[:, output]
    chance = found.chance(CHANCE)
    response = np.where(coherence > chance, found.response[:, output, source], np.nan)
    degrees = np.degrees(np.angle(response))
    degrees += 360.0 * np.round((model_deg - degrees) / 360.0)
    return [
        marks.line(at_hz, _decibels(np.abs(response)), marks.THIN, _MEASURED),
        marks.dots(at_hz, degrees, marks.SPECK, _MEASURED),
        marks.between(at_hz, 0.0, coherence.clip(0.0, 1.0), marks.AREA),
        marks.horizontals([chance], x, marks.RULE),
    ]


def _panel(y: Axis, found: Sequence[Mark], size: str = "height:12rem") -> Panel:
    return Panel(y, found, size)


def _with_known(panel: Panel, known_modes_hz: Sequence[float]) -> Panel:
    known = marks.verticals(known_modes_hz, panel.y, marks.RULE, "known modes")
    return Panel(panel.y, [*panel.marks, known], panel.size)


def _phase_axis(found: Sequence[Mark]) -> Axis:
    """Return an axis with ticks at multiples of a quarter turn."""
    around = Axis.around("phase, deg", (mark.y for mark in found))
    quarters = max(1.0, np.ceil((around.high - around.low) / 90.0 / _PHASE_TICKS))
    return Axis(around.label, around.low, around.high, step=90.0 * float(quarters))


def _unwrapped_deg(response: ComplexArray) -> FloatArray:
    known = np.isfinite(response)
    degrees = np.full(len(response), np.nan)
    degrees[known] = np.degrees(np.unwrap(np.angle(response[known])))
    return degrees


def _gain_unit(source: str, target: str) -> str:
    units = label_and_unit(target)[1], label_and_unit(source)[1]
    return f"dB ({units[0]}/{units[1]})" if all(units) else "dB"


def _decibels(gain: FloatArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(np.maximum(gain, _SMALLEST_GAIN)))
