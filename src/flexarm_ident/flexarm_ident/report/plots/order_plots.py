"""Order plots: singular values, stabilisation diagram, and cost of a reduction over the order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.spectra import Spectra
    from flexarm_ident.diagnostics.stabilisation import Pole, RecurringMode, Stabilisation
    from flexarm_ident.report.plots.marks import Mark

_SHOWN_SINGULAR_VALUES = 40
_ROOM = 1.3
_SPREAD = 2.0
_LOOKS = (
    (marks.SOLID, marks.SMALL),
    (marks.DASHED, marks.DOT),
    (marks.DOTTED, marks.SQUARE),
)
_HIGHEST = 1.5
_SIZE = "height:16rem"


def singular_value_plot(singular_values: FloatArray, order: int) -> str:
    """Plot the descending singular values of (2-21) with the chosen order marked."""
    shown, kept, rest = used_and_left_out(singular_values, order)
    x = Axis.of_counts("number", 0.0, len(shown) + 1.0)
    y = Axis.around("singular value", [shown], log=True)
    found = [
        marks.verticals([order + 0.5], y, marks.CUT, f"order {order}"),
        marks.dots(kept + 1, shown[kept], marks.DOT, "used"),
        marks.dots(rest + 1, shown[rest], marks.SQUARE, "left out"),
    ]
    words = f"singular values, order {order} chosen"
    return chart(View(words, x, [Panel(y, found, _SIZE)]))


def used_and_left_out(
    singular_values: FloatArray, order: int
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp]]:
    """Return the singular values that a plot shows, and which of them a model of an order uses.

    Returns
    -------
    shown : ndarray, (shown,)
        The largest ones, some beyond the order.
    used, left_out : ndarray of int
        Indices into them of those above zero.
    """
    shown = singular_values[: max(_SHOWN_SINGULAR_VALUES, order + _SHOWN_SINGULAR_VALUES // 4)]
    positive = np.flatnonzero(shown > 0.0)
    return shown, positive[positive < order], positive[positive >= order]


def stabilisation_plot(
    diagram: Stabilisation,
    physical: Sequence[RecurringMode],
    *,
    split: Sequence[RecurringMode] = (),
    known_modes_hz: Sequence[float] = (),
    order: int | None = None,
    measured: Spectra | None = None,
) -> str:
    """Plot the modes of all orders over their frequency.

    The axis ends a little above the highest mode that recurs or is known.

    Parameters
    ----------
    diagram : Stabilisation
        Modes per order and the recurring ones.
    physical : sequence of RecurringMode
        Those of the recurring modes that are the plant's; they are shaded.
    split : sequence of RecurringMode
        Neighbours of which one at most is the plant's; they are dashed lines.
    known_modes_hz : sequence of float
        Frequencies marked by thin lines.
    order : int, optional
        Order of the chosen model, marked by a line.
    measured : Spectra, optional
        Spectra of the outputs, drawn behind: the sum of their powers, each of the same weight, in
        decibels from the bottom to the top of the plot.
    """
    recurring_hz = [mode.frequency_hz for mode in diagram.modes]
    highest_hz = max([*recurring_hz, *known_modes_hz], default=0.0)
    end_hz = min(_ROOM * highest_hz, 0.5 / diagram.dt_s) or 0.5 / diagram.dt_s
    seen = [pole for pole in diagram.poles if pole.frequency_hz <= end_hz]
    x = Axis("frequency, Hz", 0.0, end_hz, ticks=6)
    y = Axis.of_counts("order", diagram.orders[0] - 1.0, diagram.orders[-1] + 1.0)
    found: list[Mark] = []
    if measured is not None:
        found.extend(_spectrum(measured, end_hz, y))
    for mode in physical:
        # A line that does not vary is still to be seen.
        width_hz = max(_SPREAD * mode.frequency_std_hz, 0.003 * end_hz)
        edges_hz = [mode.frequency_hz - width_hz, mode.frequency_hz + width_hz]
        found.append(marks.between(edges_hz, y.low, y.high, marks.BAND, "physical mode"))
    if split:
        split_hz = [mode.frequency_hz for mode in split]
        found.append(marks.verticals(split_hz, y, marks.DASHED, "possibly a split pole"))
    if known_modes_hz:
        found.append(marks.verticals(known_modes_hz, y, marks.RULE, "known modes"))
    unlike = [pole for pole in seen if pole.admissible and not pole.stable]
    staying = [pole for pole in seen if pole.stable]
    found += [
        marks.dots(*_places(unlike), marks.SQUARE, "new"),
        marks.dots(*_places(staying), marks.SMALL, "stays"),
    ]
    if order is not None:
        found.append(marks.horizontals([order], x, marks.CUT, f"order {order}"))
    words = f"stabilisation diagram, physical modes: {_listed_hz(physical) or 'none'}"
    if split:
        words += f"; possibly a split pole: {_listed_hz(split)}"
    return chart(View(words, x, [Panel(y, found, _SIZE)]))


def _listed_hz(modes: Sequence[RecurringMode]) -> str:
    return ", ".join(f"{mode.frequency_hz:.3g} Hz" for mode in modes)


def _spectrum(measured: Spectra, end_hz: float, y: Axis) -> list[Mark]:
    """Return the summed power of the outputs over the height of the plot; none without power."""
    inside = measured.frequencies_hz <= end_hz
    total = measured.power.sum(axis=0)
    share = measured.power[inside] / np.where(total > 0.0, total, 1.0)
    power = share.sum(axis=1)
    known = power > 0.0
    if known.sum() < 2:  # noqa: PLR2004 - a curve has two ends
        return []
    level = np.log10(power[known])
    low, high = float(level.min()), float(level.max())
    part = (level - low) / ((high - low) or 1.0)
    height = y.low + part * (y.high - y.low)
    across_hz = measured.frequencies_hz[inside][known]
    return [marks.between(across_hz, y.low, height, marks.SHADE, "spectrum")]


def _places(poles: Sequence[Pole]) -> tuple[list[float], list[int]]:
    return [pole.frequency_hz for pole in poles], [pole.order for pole in poles]


def cost_plot(
    curves: Mapping[str, Sequence[tuple[int, float]]],
    *,
    order: int,
    labels: tuple[str, str] = ("states kept", "mean error \u03b4"),
    full: float | None = None,
) -> str:
    """Plot the cost of models over their order.

    Costs of more than 1.5 are drawn at 1.5; 1 is the error of the mean.

    Parameters
    ----------
    curves : mapping of str to sequence of (int, float)
        Orders and costs by the name of the curve, three at most.
    order : int
        Order of the chosen model, marked by a line.
    labels : tuple of str
        Labels of the order and of the cost.
    full : float, optional
        Mean error of the full model, marked by a line.
    """
    limited = {
        name: ([each for each, _ in costs], np.minimum([cost for _, cost in costs], _HIGHEST))
        for name, costs in curves.items()
    }
    shown = [order, *(number for orders, _ in limited.values() for number in orders)]
    x = Axis.of_counts(labels[0], min(shown) - 0.5, max(shown) + 0.5)
    y = Axis.around(labels[1], [[0.0, full or 0.0], *(cost for _, cost in limited.values())])
    found = [marks.verticals([order], y, marks.CUT, f"order {order}")]
    if full is not None:
        found.insert(0, marks.horizontals([full], x, marks.RULE, "full model"))
    for (name, (orders, cost)), (look, point) in zip(limited.items(), _LOOKS, strict=False):
        found += [marks.line(orders, cost, look, name), marks.dots(orders, cost, point, name)]
    words = f"{labels[1]} over {labels[0]}, {', '.join(curves)}"
    return chart(View(words, x, [Panel(y, found, _SIZE)]))
