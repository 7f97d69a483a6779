"""Plots of a model against a record, and of the singular values behind its order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.ticker import MaxNLocator, NullFormatter

from flexarm_core.labels import axis_label, label_and_unit
from flexarm_ident.report.plots.order_plots import used_and_left_out
from flexarm_ident.report.plots.time_plots import CURVE_POINTS, extremes, limited
from reproduction.framework.picture import (
    BLACK,
    DOTTED,
    MARK,
    SHADE,
    SOLID,
    STYLE,
    VERMILION,
    figure_of,
    inline_svg,
    legend_above,
    plain_numbers,
)

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray


def match_plot(
    time_s: FloatArray,
    measured: FloatArray,
    simulated: FloatArray,
    name: str,
    *,
    fitted_s: float,
    points: int = CURVE_POINTS,
) -> str:
    """Plot a simulated output over the measured one as SVG, as Figures 2-7 and 2-8 do.

    Parameters
    ----------
    time_s, measured, simulated : ndarray, (samples,)
        Time and one output: solid as measured, dotted as simulated. An unstable simulation is cut
        off one range beyond the measured signal.
    name : str
        Name of the output, with its unit at the end.
    fitted_s : float
        End of the fitted part, which is shaded.
    points : int
        Most points of a curve; a longer record is drawn by its extremes.
    """
    visible = limited(simulated, measured)
    with mpl.rc_context(STYLE):
        figure = figure_of(2.2)
        axes = figure.subplots()
        if fitted_s > 0.0:
            axes.axvspan(0.0, fitted_s, color=SHADE, linewidth=0.0, label="fitted part")
        curves = (("measured", measured, SOLID), ("simulated", visible, DOTTED))
        for label, values, look in curves:
            rows = extremes(values, points)
            axes.plot(time_s[rows], values[rows], label=label, **look)
        axes.set_ylabel(axis_label(name))
        # To the end of the last period, so that the axis ends in a round number.
        end_s = time_s[0] + (time_s[-1] - time_s[0]) * len(time_s) / max(len(time_s) - 1, 1)
        axes.set(xlabel="time, s", xlim=(time_s[0], end_s))
        legend_above(axes)
        return inline_svg(figure, f"{label_and_unit(name)[0]}: measured and simulated over time")


def singular_value_plot(singular_values: FloatArray, order: int) -> str:
    """Plot the descending singular values of (2-21) with the chosen order marked, as SVG."""
    shown, kept, rest = used_and_left_out(singular_values, order)
    with mpl.rc_context(STYLE):
        figure = figure_of(3.0)
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
