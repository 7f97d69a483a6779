"""Plots of signals over time, and of gains over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from reproduction.framework.picture import (
    DASHED,
    DOTTED,
    SHADE,
    SOLID,
    STYLE,
    figure_of,
    inline_svg,
    legend_above,
    plain_numbers,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray


LOOKS = (SOLID, DASHED, DOTTED)
_POINTS = 600
_DECIMALS_DB = 6


def time_plot(
    time_s: NDArray[np.float64], signals: Mapping[str, NDArray[np.float64]], axis: str, words: str
) -> str:
    """Plot up to three signals over time, as SVG.

    Parameters
    ----------
    time_s : ndarray, (samples,)
        Time.
    signals : mapping of str to ndarray, (samples,)
        Signals by their names in the legend.
    axis : str
        Label of the axis, with its unit.
    words : str
        Description of the picture for those who cannot see it.
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


def range_plot(
    frequencies_hz: NDArray[np.float64],
    gains: NDArray[np.floating],
    channel: str,
    printed: NDArray[np.floating] | None = None,
) -> str:
    """Plot median and range of gains, and the gain of the thesis's model, as SVG.

    Parameters
    ----------
    frequencies_hz : ndarray, (frequencies,)
        Frequencies.
    gains : ndarray, (models, frequencies)
        Magnitudes.
    channel : str
        Name of the output.
    printed : ndarray, (frequencies,), optional
        Magnitude of the printed model.
    """
    # The band's name in the file is a hash of its corners, in all their digits.
    gains_db = np.round(20.0 * np.log10(np.asarray(gains, dtype=float)), _DECIMALS_DB)
    with mpl.rc_context(STYLE):
        figure = figure_of(2.2)
        axes = figure.subplots()
        axes.fill_between(
            frequencies_hz, gains_db.min(axis=0), gains_db.max(axis=0), color=SHADE, label="range"
        )
        axes.plot(frequencies_hz, np.median(gains_db, axis=0), label="ours, median", **SOLID)
        if printed is not None:
            axes.plot(frequencies_hz, 20.0 * np.log10(printed), label="printed", **DASHED)
        axes.set(xlabel="frequency, Hz", ylabel=f"{channel}, dB", xscale="log")
        axes.set_xlim(frequencies_hz[0], frequencies_hz[-1])
        axes.xaxis.set_major_formatter(plain_numbers())
        legend_above(axes)
        return inline_svg(figure, f"gain to the {channel} over frequency")
