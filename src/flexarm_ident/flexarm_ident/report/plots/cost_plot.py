"""The plot of what a reduction costs over the number of states that are kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import MaxNLocator

from flexarm_ident.report.plots.plot_style import (
    DASHED,
    DOTTED,
    MARK,
    SOLID,
    STYLE,
    VERMILION,
    figure_of,
    legend_above,
)
from flexarm_ident.report.plots.svg import inline_svg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_LOOKS = (
    {**SOLID, "marker": "o"},
    {**DASHED, "marker": "x"},
    {**DOTTED, "marker": "s", "fillstyle": "none"},
)
_HIGHEST = 1.5


def cost_plot(curves: Mapping[str, Sequence[tuple[int, float]]], *, full: float, order: int) -> str:
    """Plot the mean error of data matching over the order of the reduced model.

    Parameters
    ----------
    curves : mapping of str to sequence of (int, float)
        Orders and errors by the name of the curve, three at most.
    full : float
        Mean error of the full model, marked by a line.
    order : int
        Order of the model that was chosen, marked by a line.

    Returns
    -------
    str
        SVG. Errors of more than 1.5 are drawn at 1.5; 1 is that of a line at zero.
    """
    with mpl.rc_context(STYLE):
        figure = figure_of(3.0)
        axes = figure.subplots()
        for (name, costs), look in zip(curves.items(), _LOOKS, strict=False):
            means = np.minimum([mean for _, mean in costs], _HIGHEST)
            axes.plot([each for each, _ in costs], means, label=name, markersize=4.0, **look)
        axes.axhline(full, color=MARK, linewidth=0.9, label="full model")
        axes.axvline(order, color=VERMILION, linestyle="--", linewidth=0.9, label=f"order {order}")
        axes.set(xlabel="states kept", ylabel="mean error δ")
        axes.set_ylim(bottom=0.0)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        legend_above(axes, columns=2)
        return inline_svg(figure, f"mean error over states kept, {', '.join(curves)}")
