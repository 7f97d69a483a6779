"""Frequency response plot, with a band of standard deviations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import MultipleLocator, NullFormatter

from flexarm_core.labels import label_and_unit
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.modes import frequency_and_damping
from flexarm_ident.report.plots.style import (
    BLUE,
    DASHED,
    MARK,
    SOLID,
    STYLE,
    VERMILION,
    figure_of,
    inline_svg,
    legend_above,
    plain_numbers,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control
    from matplotlib.axes import Axes

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.spectra import Spectra

_GRID_POINTS = 400
_SMALLEST_GAIN = 1e-12
_BAND_DEPTH_DB = 20.0
_PHASE_TICKS = 4
# Coherence that unrelated signals exceed at one frequency of a hundred.
_CHANCE = 0.01


def frequency_plot(
    full: control.StateSpace,
    reduced: control.StateSpace | None,
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
    full, reduced : control.StateSpace
        Discrete models; the reduced one may be None.
    output, source : int
        Numbers of the output and of the input, from 0.
    frequencies_hz : ndarray, (frequencies,)
        Frequencies, see `frequency_grid`.
    deviation : ndarray, (frequencies,), optional
        Standard deviation of the full model's complex gain; the band is twice as wide.
    measured : Spectra, optional
        Nonparametric response, drawn behind the models, and the coherence.
    known_modes_hz : sequence of float
        Frequencies marked by thin lines.
    """
    names = full.input_labels[source], full.output_labels[output]
    curves = [("full", full, SOLID)]
    if reduced is not None:
        curves.append(("reduced", reduced, DASHED))
    with mpl.rc_context(STYLE):
        rows = [3, 2] if measured is None else [3, 2, 1]
        figure = figure_of(3.4 if measured is None else 4.2)
        panels = figure.subplots(len(rows), sharex=True, height_ratios=rows)
        magnitude, phase = panels[:2]
        first_deg: FloatArray | None = None
        for kind, model, look in curves:
            label = f"{kind}, {model.nstates} states"
            response = frequency_response(model, frequencies_hz)[:, output, source]
            decibels = _decibels(np.abs(response))
            degrees = np.degrees(np.unwrap(np.angle(response)))
            first_deg = degrees if first_deg is None else first_deg
            # Whole turns mean nothing: take those that bring the curves together.
            degrees = degrees - 360.0 * np.round((degrees - first_deg) / 360.0)
            magnitude.plot(frequencies_hz, decibels, label=label, **look)
            phase.plot(frequencies_hz, degrees, **look)
            if model is full and deviation is not None:
                edges = _decibels(np.abs(response) + np.outer([-2.0, 2.0], deviation))
                floor = decibels.min() - _BAND_DEPTH_DB
                magnitude.fill_between(
                    frequencies_hz,
                    *np.maximum(edges, floor),
                    color=BLUE,
                    alpha=0.35,
                    linewidth=0.0,
                    label="two deviations",
                )
        if measured is not None and first_deg is not None:
            turned_deg = np.interp(measured.frequencies_hz, frequencies_hz, first_deg)
            _draw_measured(panels, measured, (output, source), turned_deg)
        for axes in panels:
            for known_hz in known_modes_hz:
                line = axes.axvline(known_hz, color=VERMILION, linewidth=0.7)
                # One entry of the legend stands for all.
                line.set_label("known modes" if known_hz == known_modes_hz[0] else "")
        magnitude.set(ylabel=f"gain, {_gain_unit(*names)}", xscale="log")
        phase.set(ylabel="phase, deg")
        panels[-1].set(xlabel="frequency, Hz")
        phase.set_xlim(frequencies_hz[0], frequencies_hz[-1])
        phase.xaxis.set_major_formatter(plain_numbers())
        phase.xaxis.set_minor_formatter(NullFormatter())
        low_deg, high_deg = phase.get_ylim()
        quarters = max(1.0, np.ceil((high_deg - low_deg) / 90.0 / _PHASE_TICKS))
        phase.yaxis.set_major_locator(MultipleLocator(90.0 * quarters))
        legend_above(magnitude, columns=2)
        cause, effect = (label_and_unit(name)[0] for name in names)
        return inline_svg(figure, f"frequency response from {cause} to {effect}")


def _draw_measured(
    panels: Sequence[Axes], found: Spectra, channels: tuple[int, int], model_deg: FloatArray
) -> None:
    """Draw the response where the output is coherent with the inputs, and the coherence.

    The phase takes the whole turns of the model's, (frequencies,).
    """
    (magnitude, phase, below), (output, source) = panels, channels
    coherence = found.coherence[:, output]
    chance = found.chance(_CHANCE)
    response = np.where(coherence > chance, found.response[:, output, source], np.nan)
    look: Any = {"color": MARK, "linewidth": 0.9, "alpha": 0.7, "zorder": 0}
    decibels = _decibels(np.abs(response))
    magnitude.plot(found.frequencies_hz, decibels, label="measured", **look)
    degrees = np.degrees(np.angle(response))
    degrees += 360.0 * np.round((model_deg - degrees) / 360.0)
    phase.plot(found.frequencies_hz, degrees, ".", markersize=1.5, **look)
    below.fill_between(found.frequencies_hz, coherence.clip(0.0, 1.0), color=MARK, linewidth=0.0)
    below.axhline(chance, color=VERMILION, linewidth=0.7)
    below.set(ylabel="coh.", ylim=(0.0, 1.0))


def frequency_grid(model: control.StateSpace, lowest_hz: float) -> FloatArray:
    """Return a logarithmic grid of frequencies in Hz, refined around each mode by its own width.

    It goes from `lowest_hz` to the Nyquist frequency of the discrete model.
    """
    nyquist_hz = 0.5 / model.dt
    grid = [np.geomspace(min(lowest_hz, 0.1 * nyquist_hz), nyquist_hz, _GRID_POINTS)]
    for eigenvalue in np.linalg.eigvals(model.A):
        frequency_hz, damping_ratio = frequency_and_damping(complex(eigenvalue), model.dt)
        if eigenvalue.imag > 0.0:
            width = min(abs(damping_ratio), 0.1)
            grid.append(frequency_hz * (1.0 + width * np.linspace(-4.0, 4.0, 17)))
    merged = np.unique(np.concatenate(grid))
    return np.asarray(merged[(merged >= grid[0][0]) & (merged <= nyquist_hz)])


def _gain_unit(source: str, target: str) -> str:
    units = label_and_unit(target)[1], label_and_unit(source)[1]
    return f"dB ({units[0]}/{units[1]})" if all(units) else "dB"


def _decibels(gain: FloatArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(np.maximum(gain, _SMALLEST_GAIN)))
