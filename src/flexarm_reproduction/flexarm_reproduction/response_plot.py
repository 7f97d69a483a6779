"""Gains of many models of one kind over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from flexarm_ident.plot_style import SHADE, SOLID, STYLE, figure_of, legend_above, plain_numbers
from flexarm_ident.svg import inline_svg

if TYPE_CHECKING:
    from numpy.typing import NDArray


def range_plot(
    frequencies_hz: NDArray[np.float64], gains: NDArray[np.floating], channel: str
) -> str:
    """Plot the median of the gains and their range.

    Parameters
    ----------
    frequencies_hz : ndarray, (frequencies,)
        Frequencies.
    gains : ndarray, (models, frequencies)
        Magnitudes.
    channel
        Name of the output.

    Returns
    -------
    str
        SVG.
    """
    gains_db = 20.0 * np.log10(np.asarray(gains, dtype=float))
    with mpl.rc_context(STYLE):
        figure = figure_of(2.2)
        axes = figure.subplots()
        axes.fill_between(
            frequencies_hz, gains_db.min(axis=0), gains_db.max(axis=0), color=SHADE, label="range"
        )
        axes.plot(frequencies_hz, np.median(gains_db, axis=0), label="median", **SOLID)
        axes.set(xlabel="frequency, Hz", ylabel=f"{channel}, dB", xscale="log")
        axes.set_xlim(frequencies_hz[0], frequencies_hz[-1])
        axes.xaxis.set_major_formatter(plain_numbers())
        legend_above(axes)
        return inline_svg(figure, f"gain to the {channel} over frequency")
