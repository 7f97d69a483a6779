"""The plot of a stabilisation diagram, as SVG text like those of `plots`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.ticker import MaxNLocator

from flexarm_ident.report.plots.plot_style import (
    BLACK,
    BLUE,
    MARK,
    STYLE,
    VERMILION,
    figure_of,
    legend_above,
    plain_numbers,
)
from flexarm_ident.report.plots.svg import inline_svg

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.diagnostics.stabilisation import Pole, Stabilisation

_ROOM = 1.3
_SPREAD = 2.0


def stabilisation_plot(
    diagram: Stabilisation, *, known_modes_hz: Sequence[float] = (), order: int | None = None
) -> str:
    """Plot the modes of all orders over their frequency.

    Parameters
    ----------
    diagram : Stabilisation
        Modes per order and the physical ones.
    known_modes_hz : sequence of float
        Frequencies that are marked by thin lines.
    order : int, optional
        Order of the model that was chosen, marked by a line.

    Returns
    -------
    str
        SVG. The axis ends a little above the highest mode that is stable over the orders or known.
    """
    shaded = [(mode.frequency_hz, mode.frequency_std_hz) for mode in diagram.modes]
    highest_hz = max([frequency_hz for frequency_hz, _ in shaded] + list(known_modes_hz), default=0)
    end_hz = min(_ROOM * highest_hz, 0.5 / diagram.dt_s) or 0.5 / diagram.dt_s
    seen = [pole for pole in diagram.poles if pole.frequency_hz <= end_hz]
    stable = [pole for pole in seen if pole.stable]
    unlike = [pole for pole in seen if pole.admissible and not pole.stable]
    with mpl.rc_context(STYLE):
        figure = figure_of(3.4)
        axes = figure.subplots()
        for number, (frequency_hz, std_hz) in enumerate(shaded):
            # A line that does not vary is still to be seen.
            width_hz = max(_SPREAD * std_hz, 0.003 * end_hz)
            axes.axvspan(
                frequency_hz - width_hz,
                frequency_hz + width_hz,
                color=BLUE,
                alpha=0.35,
                linewidth=0.0,
                label="" if number else "physical mode",
            )
        for number, known_hz in enumerate(known_modes_hz):
            axes.axvline(
                known_hz, color=VERMILION, linewidth=0.9, label="" if number else "known modes"
            )
        axes.plot(*_places(unlike), "x", color=MARK, markersize=3.0, label="new")
        axes.plot(*_places(stable), "o", color=BLACK, markersize=2.6, label="stable")
        if order is not None:
            axes.axhline(order, color=BLACK, linestyle="--", linewidth=0.8, label=f"order {order}")
        axes.set(xlabel="frequency, Hz", ylabel="order", xlim=(0.0, end_hz))
        axes.set_ylim(diagram.orders[0] - 1.0, diagram.orders[-1] + 1.0)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.xaxis.set_major_formatter(plain_numbers())
        legend_above(axes)
        modes = ", ".join(f"{frequency_hz:.3g} Hz" for frequency_hz, _ in shaded) or "none"
        return inline_svg(figure, f"stabilisation diagram, physical modes: {modes}")


def _places(poles: Sequence[Pole]) -> tuple[list[float], list[int]]:
    return [pole.frequency_hz for pole in poles], [pole.order for pole in poles]
