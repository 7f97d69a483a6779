"""The plots of a report, each a pure function from numbers to SVG text.

Every plot is narrow, so that a page can set two side by side and a phone one below the other.
Colours are distinct to the colour-blind, and in black and white the line styles tell curves apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import MaxNLocator, NullFormatter

from flexarm_ident.channels import axis_label, label_and_unit
from flexarm_ident.modes import frequency_and_damping
from flexarm_ident.plot_style import (
    BLACK,
    DASHED,
    DOTTED,
    MARK,
    SHADE,
    SOLID,
    STYLE,
    VERMILION,
    figure_of,
    legend_above,
    plain_numbers,
)
from flexarm_ident.svg import inline_svg
from flexarm_ident.validation import frequency_response

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from flexarm_ident.arrays import FloatArray

CURVE_POINTS = 2000

_SHOWN_SINGULAR_VALUES = 40
_GRID_POINTS = 400
_SMALLEST_GAIN = 1e-12
_BAND_DEPTH_DB = 20.0


def match_plot(
    time_s: FloatArray,
    measured: FloatArray,
    simulated: FloatArray,
    name: str,
    *,
    fitted_s: float,
    points: int = CURVE_POINTS,
) -> str:
    """Plot a simulated output over the measured one, as Figures 2-7 and 2-8 do.

    Parameters
    ----------
    time_s, measured, simulated : ndarray, (samples,)
        Time and one output: solid as measured, dotted as simulated.
    name : str
        Name of the output, with its unit at the end.
    fitted_s : float
        End of the part that was fitted, which is shaded.
    points : int
        Most points of a curve; a longer record is drawn by its extremes.

    Returns
    -------
    str
        SVG. A simulation that runs away is cut off one range beyond the measured signal.
    """
    low, high = float(measured.min()), float(measured.max())
    span = (high - low) or 1.0
    visible = np.clip(np.nan_to_num(simulated, nan=high + span), low - span, high + span)
    with mpl.rc_context(STYLE):
        figure = figure_of(2.0)
        axes = figure.subplots()
        axes.axvspan(0.0, fitted_s, color=SHADE, linewidth=0.0, label="fitted part")
        curves = (("measured", measured, SOLID), ("simulated", visible, DOTTED))
        for label, values, look in curves:
            rows = _extremes(values, points)
            axes.plot(time_s[rows], values[rows], label=label, **look)
        axes.set_ylabel(axis_label(name))
        _time_axis(axes, time_s)
        legend_above(axes)
        return inline_svg(figure, f"{label_and_unit(name)[0]}: measured and simulated over time")


def singular_value_plot(singular_values: FloatArray, order: int) -> str:
    """Plot the singular values of (2-21) with the chosen order marked.

    Parameters
    ----------
    singular_values : ndarray
        Singular values, descending.
    order : int
        Chosen order.

    Returns
    -------
    str
        SVG.
    """
    shown = singular_values[: max(_SHOWN_SINGULAR_VALUES, order + _SHOWN_SINGULAR_VALUES // 4)]
    positive = np.flatnonzero(shown > 0.0)
    kept, rest = positive[positive < order], positive[positive >= order]
    with mpl.rc_context(STYLE):
        figure = figure_of(2.2)
        axes = figure.subplots()
        axes.set_yscale("log")
        axes.plot(kept + 1, shown[kept], "o", color=BLACK, markersize=3.5, label="used")
        axes.plot(
            rest + 1,
            shown[rest],
            "o",
            color=MARK,
            markersize=3.5,
            fillstyle="none",
            label="left out",
        )
        axes.axvline(order + 0.5, color=VERMILION, linestyle="--", label=f"order {order}")
        axes.set(xlabel="number", ylabel="singular value", xlim=(0.0, len(shown) + 1.0))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.set_major_formatter(plain_numbers())
        axes.yaxis.set_minor_formatter(NullFormatter())
        legend_above(axes)
        return inline_svg(figure, f"singular values, order {order} chosen")


def frequency_plot(
    full: control.StateSpace,
    reduced: control.StateSpace | None,
    output: int,
    *,
    frequencies_hz: FloatArray,
    deviation: FloatArray | None = None,
    known_modes_hz: Sequence[float] = (),
) -> str:
    """Plot the frequency response (2-4) from the first input to one output.

    Parameters
    ----------
    full, reduced : control.StateSpace
        Discrete models; there may be no reduced one.
    output : int
        Number of the output, from 0.
    frequencies_hz : ndarray, (frequencies,)
        Frequencies, see `frequency_grid`.
    deviation : ndarray, (frequencies,), optional
        Standard deviation of the full model's complex gain; twice of it is a band.
    known_modes_hz : sequence of float
        Frequencies that are marked by thin lines.

    Returns
    -------
    str
        SVG with magnitude and phase.
    """
    source, target = full.input_labels[0], full.output_labels[output]
    curves = [("full", full, SOLID)]
    if reduced is not None:
        curves.append(("reduced", reduced, DASHED))
    with mpl.rc_context(STYLE):
        figure = figure_of(3.0)
        magnitude, phase = figure.subplots(2, sharex=True, height_ratios=[3, 2])
        first_deg: FloatArray | None = None
        for kind, model, look in curves:
            label = f"{kind}, {model.nstates} states"
            response = frequency_response(model, frequencies_hz)[:, output, 0]
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
                    color=SHADE,
                    linewidth=0.0,
                    label="two deviations",
                )
        for axes in (magnitude, phase):
            for known_hz in known_modes_hz:
                line = axes.axvline(known_hz, color=VERMILION, linewidth=0.7)
                # One entry of the legend stands for all.
                line.set_label("known modes" if known_hz == known_modes_hz[0] else "")
        magnitude.set(ylabel=f"gain, {_gain_unit(source, target)}", xscale="log")
        phase.set(xlabel="frequency, Hz", ylabel="phase, deg")
        phase.set_xlim(frequencies_hz[0], frequencies_hz[-1])
        phase.xaxis.set_major_formatter(plain_numbers())
        phase.xaxis.set_minor_formatter(NullFormatter())
        phase.yaxis.set_major_locator(MaxNLocator(5, steps=[1.8, 3.6, 4.5, 9.0]))
        legend_above(magnitude, columns=2)
        return inline_svg(figure, f"frequency response to {label_and_unit(target)[0]}")


def step_plot(
    time_s: FloatArray, volts: FloatArray, reference_v: FloatArray, command_v: FloatArray
) -> str:
    """Plot a controlled motion of the arm.

    Parameters
    ----------
    time_s : ndarray, (samples,)
        Time.
    volts : ndarray, (samples, 4)
        Position, base strain, middle strain and speed.
    reference_v : ndarray, (samples,)
        Set-point of the position.
    command_v : ndarray, (samples,)
        Command of the drive.

    Returns
    -------
    str
        SVG with position, strain gauges, speed and command above each other.
    """
    position_v, base_v, middle_v, speed_v = volts.T
    panels = (
        ("position, V", (("position", position_v), ("set-point", reference_v))),
        ("strain, V", (("base", base_v), ("middle", middle_v))),
        ("speed, V", (("speed", speed_v),)),
        ("command, V", (("command", command_v),)),
    )
    with mpl.rc_context(STYLE):
        figure = figure_of(5.2)
        for axes, (label, curves) in zip(
            figure.subplots(len(panels), sharex=True), panels, strict=True
        ):
            for (name, values), look in zip(curves, (SOLID, DASHED), strict=False):
                rows = _extremes(values, CURVE_POINTS)
                axes.plot(time_s[rows], values[rows], label=name, **{**look, "linewidth": 1.0})
            axes.set_ylabel(label)
            if len(curves) > 1:
                legend_above(axes)
        _time_axis(axes, time_s)
        figure.align_ylabels()
        return inline_svg(
            figure, "controlled motion: position, strain, speed and command over time"
        )


def _time_axis(axes: Axes, time_s: FloatArray) -> None:
    # To the end of the last period, so that the axis ends in a round number.
    end_s = time_s[0] + (time_s[-1] - time_s[0]) * len(time_s) / max(len(time_s) - 1, 1)
    axes.set(xlabel="time, s", xlim=(time_s[0], end_s))


def _gain_unit(source: str, target: str) -> str:
    units = label_and_unit(target)[1], label_and_unit(source)[1]
    return f"dB ({units[0]}/{units[1]})" if all(units) else "dB"


def _extremes(values: FloatArray, points: int) -> NDArray[np.intp]:
    """Return the rows of the extremes of equal parts, so that no peak is lost."""
    if len(values) <= points:
        return np.arange(len(values))
    rows: list[int] = []
    for part in np.array_split(np.arange(len(values)), points // 2):
        inside = values[part]
        rows.extend(part[sorted({int(inside.argmin()), int(inside.argmax())})])
    return np.array(rows)


def _decibels(gain: FloatArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(np.maximum(gain, _SMALLEST_GAIN)))


def frequency_grid(model: control.StateSpace, lowest_hz: float) -> FloatArray:
    """Return a logarithmic grid, refined around each mode by its own width.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    lowest_hz : float
        Lowest frequency; the highest is the Nyquist frequency.

    Returns
    -------
    ndarray, (frequencies,)
        Frequencies.
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
