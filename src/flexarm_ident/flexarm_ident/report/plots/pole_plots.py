"""Pole plots: the z plane with the unit circle, and damping over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter

from flexarm_ident.report.plots.style import (
    BLACK,
    BLUE,
    MARK,
    STYLE,
    figure_of,
    inline_svg,
    legend_above,
    plain_numbers,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from flexarm_ident.models.modes import Mode, ModeUncertainty

_LEFT_OUT: Any = {"color": MARK, "marker": "o", "linestyle": "none", "fillstyle": "none"}
_KEPT: Any = {"color": BLACK, "marker": "x", "linestyle": "none"}
_SIDES: Any = {1: "left", 0: "center", -1: "right"}
_TICKED_SHARES = (0.1, 0.25, 0.5, 0.75)


def pole_plot(modes: Sequence[Mode], dt_s: float) -> str:
    """Plot the eigenvalues of a model in the z plane, with the unit circle.

    Parameters
    ----------
    modes : sequence of Mode
        All modes; the kept ones are highlighted.
    dt_s : float
        Sampling period, for the frequencies along the circle.
    """
    with mpl.rc_context(STYLE):
        figure = figure_of(3.6)
        axes = figure.subplots()
        circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 181))
        axes.plot(circle.real, circle.imag, color=BLUE, linewidth=0.9)
        for share in _TICKED_SHARES:
            place = np.exp(1j * np.pi * share)
            axes.plot(place.real, place.imag, "|", color=BLUE, markersize=4.0)
            axes.annotate(
                f"{0.5 * share / dt_s:.4g} Hz",
                (1.06 * place.real, 1.06 * place.imag),
                ha=_SIDES[int(np.sign(place.real.round(3)))],
                va="bottom",
                color=MARK,
            )
        for kept, label, look in ((False, "left out", _LEFT_OUT), (True, "in the model", _KEPT)):
            poles = np.array([mode.eigenvalue for mode in modes if mode.kept is kept])
            if len(poles):
                both = np.concatenate([poles, poles.conj()])
                axes.plot(both.real, both.imag, label=label, markersize=5.0, **look)
        axes.set(xlabel="real part of z", ylabel="imaginary part of z")
        reach = max([1.0, *(abs(mode.eigenvalue) for mode in modes)])
        axes.set(xlim=(-1.45 * reach, 1.45 * reach), ylim=(-1.1 * reach, 1.22 * reach))
        axes.set_aspect("equal")
        legend_above(axes)
        outside = sum(abs(mode.eigenvalue) >= 1.0 for mode in modes)
        return inline_svg(
            figure, f"poles of {len(modes)} modes, {outside} not inside the unit circle"
        )


def damping_plot(modes: Sequence[Mode], deviations: Sequence[ModeUncertainty] = ()) -> str:
    """Plot damping ratio over frequency, with one standard deviation to each side.

    Parameters
    ----------
    modes : sequence of Mode
        All modes; only those with a frequency are drawn.
    deviations : sequence of ModeUncertainty
        Scatter of each mode, or none. Bars end at the edge of the plot.
    """
    pairs = [(i, mode) for i, mode in enumerate(modes) if mode.frequency_hz > 0.0]
    with mpl.rc_context(STYLE):
        figure = figure_of(3.6)
        axes = figure.subplots()
        for kept, label, look in ((False, "left out", _LEFT_OUT), (True, "in the model", _KEPT)):
            rows = [i for i, mode in pairs if mode.kept is kept]
            if rows:
                _scattered(axes, modes, rows, deviations, label=label, **look)
        if pairs:
            frequencies_hz = [mode.frequency_hz for _, mode in pairs]
            axes.set_xlim(0.7 * min(frequencies_hz), 1.4 * max(frequencies_hz))
            damping = [0.0, *(mode.damping_ratio for _, mode in pairs)]
            room = 0.08 * (max(damping) - min(damping) or 1.0)
            axes.set_ylim(min(damping) - room, max(damping) + room)
            legend_above(axes)
        axes.set(xlabel="frequency, Hz", ylabel="damping ratio", xscale="log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(plain_numbers())
        axes.xaxis.set_minor_formatter(NullFormatter())
        return inline_svg(figure, f"damping ratio over frequency of {len(pairs)} modes")


def _scattered(
    axes: Axes,
    modes: Sequence[Mode],
    rows: Sequence[int],
    deviations: Sequence[ModeUncertainty],
    **look: Any,  # noqa: ANN401 - matplotlib's own
) -> None:
    frequencies_hz = [modes[i].frequency_hz for i in rows]
    damping = [modes[i].damping_ratio for i in rows]
    spread: Any = {}
    if deviations:
        # A bar to zero has no place on a logarithmic axis.
        left = [min(deviations[i].frequency_std_hz, 0.99 * modes[i].frequency_hz) for i in rows]
        right = [deviations[i].frequency_std_hz for i in rows]
        spread = {
            "xerr": (left, right),
            "yerr": [deviations[i].damping_std for i in rows],
            "elinewidth": 0.7,
            "ecolor": BLUE,
        }
    axes.errorbar(frequencies_hz, damping, markersize=5.0, **spread, **look)
