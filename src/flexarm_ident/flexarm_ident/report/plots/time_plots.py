"""Time plots: an output as measured and as simulated, an input, and a controlled motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from flexarm_core.arrays import runs
from flexarm_core.labels import axis_label, label_and_unit
from flexarm_ident.report.plots.style import (
    DASHED,
    DOTTED,
    SHADE,
    SOLID,
    STYLE,
    VERMILION,
    figure_of,
    inline_svg,
    legend_above,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray

CURVE_POINTS = 2000
_SHOWN_HOLES = 200


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
        Time and one output: solid as measured, dotted as simulated. Where the measured one is NaN
        it breaks off, and a bar at the bottom marks the hole. An unstable simulation is cut off
        one range beyond the measured signal.
    name : str
        Name of the output, with its unit at the end.
    fitted_s : float
        End of the fitted part, which is shaded.
    points : int
        Most points of a curve; a longer record is drawn by its extremes.
    """
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    span = (high - low) or 1.0
    visible = np.clip(np.nan_to_num(simulated, nan=high + span), low - span, high + span)
    with mpl.rc_context(STYLE):
        figure = figure_of(2.2)
        axes = figure.subplots()
        if fitted_s > 0.0:
            axes.axvspan(0.0, fitted_s, color=SHADE, linewidth=0.0, label="fitted part")
        curves = (("measured", measured, SOLID), ("simulated", visible, DOTTED))
        for label, values, look in curves:
            rows = _extremes(values, points)
            axes.plot(time_s[rows], values[rows], label=label, **look)
        _mark_holes(axes, time_s, np.isnan(measured))
        axes.set_ylabel(axis_label(name))
        _time_axis(axes, time_s)
        legend_above(axes)
        return inline_svg(figure, f"{label_and_unit(name)[0]}: measured and simulated over time")


def _mark_holes(axes: Axes, time_s: FloatArray, missing: BoolArray) -> None:
    """Draw a bar along the bottom where nothing was measured, of many holes the longest only."""
    holes = runs(missing)
    if not len(holes):
        return
    longest = holes[np.argsort(holes[:, 0] - holes[:, 1], kind="stable")[:_SHOWN_HOLES]]
    starts_s = time_s[longest[:, 0]]
    lengths_s = (longest[:, 1] - longest[:, 0]) * (time_s[1] - time_s[0])
    axes.broken_barh(
        list(zip(starts_s.tolist(), lengths_s.tolist(), strict=True)),
        (0.0, 0.04),
        transform=axes.get_xaxis_transform(),
        color=VERMILION,
        label="holes",
    )


def input_plot(
    time_s: FloatArray, values: FloatArray, name: str, *, points: int = CURVE_POINTS
) -> str:
    """Plot an input, (samples,), over time; a long record is drawn by its extremes."""
    with mpl.rc_context(STYLE):
        figure = figure_of(1.9)
        axes = figure.subplots()
        rows = _extremes(values, points)
        axes.plot(time_s[rows], values[rows], **{**SOLID, "linewidth": 1.0})
        axes.set_ylabel(axis_label(name))
        _time_axis(axes, time_s)
        return inline_svg(figure, f"{label_and_unit(name)[0]} over time")


def step_plot(
    time_s: FloatArray, volts: FloatArray, reference_v: FloatArray, command_v: FloatArray
) -> str:
    """Plot position, strain gauges, speed and command of a controlled motion of the arm.

    Parameters
    ----------
    time_s : ndarray, (samples,)
        Time.
    volts : ndarray, (samples, 4)
        Position, base strain, middle strain and speed.
    reference_v, command_v : ndarray, (samples,)
        Set-point of the position, and command of the drive.
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


def _extremes(values: FloatArray, points: int) -> NDArray[np.intp]:
    """Return the rows of the extremes of equal parts, so that no peak is lost."""
    if len(values) <= points:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), points // 2 + 1).astype(np.intp)
    longest = int(np.diff(edges).max())
    # Shorter parts are filled up with their last row.
    rows = np.minimum(edges[:-1, None] + np.arange(longest), edges[1:, None] - 1)
    inside = values[rows]
    missing = np.isnan(inside)
    lowest = np.where(missing, np.inf, inside).argmin(axis=1)
    highest = np.where(missing, -np.inf, inside).argmax(axis=1)
    # One row of each hole breaks the curve off.
    broken = np.flatnonzero(missing.any(axis=1))
    part = np.arange(len(rows))
    found = rows[part, lowest], rows[part, highest], rows[broken, missing.argmax(axis=1)[broken]]
    return np.unique(np.concatenate(found))
