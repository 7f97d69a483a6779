"""Signals over time, several in one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from flexarm_ident.report.plots.plot_style import (
    DASHED,
    DOTTED,
    SOLID,
    STYLE,
    figure_of,
    legend_above,
)
from flexarm_ident.report.plots.svg import inline_svg

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

LOOKS = (SOLID, DASHED, DOTTED)
_POINTS = 600


def time_plot(
    time_s: NDArray[np.float64], signals: Mapping[str, NDArray[np.float64]], axis: str, words: str
) -> str:
    """Plot up to three signals over time.

    Parameters
    ----------
    time_s : ndarray, (samples,)
        Time.
    signals : mapping of str to ndarray, (samples,)
        Signals by their names in the legend.
    axis
        Label of the axis, with its unit.
    words
        What the picture shows, for those who cannot see it.

    Returns
    -------
    str
        SVG.
    """
    every = max(1, len(time_s) // _POINTS)
    with mpl.rc_context(STYLE):
        figure = figure_of(2.0)
        axes = figure.subplots()
        for (name, values), look in zip(signals.items(), LOOKS, strict=False):
            axes.plot(time_s[::every], values[::every], label=name, **look)
        axes.set(xlabel="time, s", ylabel=axis, xlim=(time_s[0], np.ceil(time_s[-1])))
        legend_above(axes)
        return inline_svg(figure, words)
