"""Order plots: singular values, stabilisation diagram, and cost of a reduction over the order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import MaxNLocator, NullFormatter

from flexarm_ident.report.plots.style import (
    BLACK,
    BLUE,
    DASHED,
    DOTTED,
    MARK,
    SOLID,
    STYLE,
    VERMILION,
    figure_of,
    inline_svg,
    legend_above,
    plain_numbers,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.stabilisation import Pole, RecurringMode, Stabilisation

_SHOWN_SINGULAR_VALUES = 40
_ROOM = 1.3
_SPREAD = 2.0
_LOOKS = (
    {**SOLID, "marker": "o"},
    {**DASHED, "marker": "x"},
    {**DOTTED, "marker": "s", "fillstyle": "none"},
)
_HIGHEST = 1.5


def singular_value_plot(singular_values: FloatArray, order: int) -> str:
    """Plot the descending singular values of (2-21) with the chosen order marked."""
    shown = singular_values[: max(_SHOWN_SINGULAR_VALUES, order + _SHOWN_SINGULAR_VALUES // 4)]
    positive = np.flatnonzero(shown > 0.0)
    kept, rest = positive[positive < order], positive[positive >= order]
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


def stabilisation_plot(
    diagram: Stabilisation,
    physical: Sequence[RecurringMode],
    *,
    known_modes_hz: Sequence[float] = (),
    order: int | None = None,
) -> str:
    """Plot the modes of all orders over their frequency.

    The axis ends a little above the highest mode that recurs or is known.

    Parameters
    ----------
    diagram : Stabilisation
        Modes per order and the recurring ones.
    physical : sequence of RecurringMode
        Those of the recurring modes that are the plant's; they are shaded.
    known_modes_hz : sequence of float
        Frequencies marked by thin lines.
    order : int, optional
        Order of the chosen model, marked by a line.
    """
    shaded = [(mode.frequency_hz, mode.frequency_std_hz) for mode in physical]
    recurring_hz = [mode.frequency_hz for mode in diagram.modes]
    highest_hz = max([*recurring_hz, *known_modes_hz], default=0.0)
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


def cost_plot(curves: Mapping[str, Sequence[tuple[int, float]]], *, full: float, order: int) -> str:
    """Plot the mean error of data matching over the order of the reduced model.

    Errors of more than 1.5 are drawn at 1.5; 1 is that of a line at zero.

    Parameters
    ----------
    curves : mapping of str to sequence of (int, float)
        Orders and errors by the name of the curve, three at most.
    full : float
        Mean error of the full model, marked by a line.
    order : int
        Order of the chosen model, marked by a line.
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
