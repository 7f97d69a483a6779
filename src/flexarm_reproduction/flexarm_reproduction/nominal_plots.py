"""Gains of a printed model beside those of many identified ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from flexarm_ident.plot_style import (
    DASHED,
    SHADE,
    SOLID,
    STYLE,
    figure_of,
    legend_above,
    plain_numbers,
)
from flexarm_ident.svg import inline_svg

if TYPE_CHECKING:
    from numpy.typing import NDArray


def gain_plot(
    frequencies_hz: NDArray[np.float64],
    printed: NDArray[np.complex128],
    ours: NDArray[np.complex128],
    channel: str,
) -> str:
    """Plot the gain to one channel.

    Parameters
    ----------
    frequencies_hz
        Frequencies.
    printed
        Response of the printed model.
    ours : ndarray, (seeds, frequencies)
        Responses of ours: their median, and their range as a shade.
    channel
        Its name.

    Returns
    -------
    str
        SVG.
    """
    gains_db = 20.0 * np.log10(np.abs(ours))
    with mpl.rc_context(STYLE):
        figure = figure_of(2.2)
        axes = figure.subplots()
        axes.fill_between(
            frequencies_hz, gains_db.min(axis=0), gains_db.max(axis=0), color=SHADE, label="range"
        )
        axes.plot(frequencies_hz, np.median(gains_db, axis=0), label="ours", **SOLID)
        axes.plot(frequencies_hz, 20.0 * np.log10(np.abs(printed)), label="printed", **DASHED)
        axes.set(xlabel="frequency, Hz", ylabel=f"{channel}, dB", xscale="log")
        axes.set_xlim(frequencies_hz[0], frequencies_hz[-1])
        axes.xaxis.set_major_formatter(plain_numbers())
        legend_above(axes)
        return inline_svg(figure, f"gain to {channel} over frequency")
