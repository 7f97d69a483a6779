"""Plots of an identification with matplotlib: its response, and the modes over the orders."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.estimation.physical_modes import PHYSICAL, SPLIT, standing_as
from flexarm_ident.fitting.validation import frequency_response

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control
    from matplotlib.axes import Axes

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.stabilisation import Stabilisation
    from flexarm_ident.estimation.physical_modes import JudgedMode

_LOOKS: dict[str, dict[str, Any]] = {
    PHYSICAL: {"linewidth": 5.0, "alpha": 0.3},
    SPLIT: {"linewidth": 1.0, "linestyle": ":"},
}
_LABELS = {PHYSICAL: "physical mode", SPLIT: "possibly a split pole"}
_BAND = 2.0
"""Half the width of a band, in standard deviations."""


def plot_response(
    model: control.StateSpace,
    frequencies_hz: FloatArray,
    deviation: FloatArray | None,
    axes: Axes | None,
) -> Axes:
    """Plot the gain of every output over the frequency, with its band where it is known.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model; its first input counts.
    frequencies_hz : ndarray, (frequencies,)
        Frequencies.
    deviation : ndarray, (frequencies, outputs, inputs), or None
        Standard deviation of the complex gain.
    axes : matplotlib.axes.Axes or None
        Axes to draw on; None for a new figure.
    """
    axes = _new() if axes is None else axes
    gain = np.abs(frequency_response(model, frequencies_hz)[:, :, 0])
    for output, name in enumerate(model.output_labels):
        (line,) = axes.loglog(frequencies_hz, gain[:, output], label=label_and_unit(name)[0])
        if deviation is not None:
            spread = _BAND * deviation[:, output, 0]
            low = np.maximum(gain[:, output] - spread, gain[:, output].min() / 10.0)
            axes.fill_between(
                frequencies_hz, low, gain[:, output] + spread, color=line.get_color(), alpha=0.2
            )
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel(f"gain from {label_and_unit(model.input_labels[0])[0]}")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    return axes


def plot_stabilisation(
    diagram: Stabilisation, judged: Sequence[JudgedMode], order: int, axes: Axes | None
) -> Axes:
    """Plot the modes of all orders over their frequency; those of the plant are marked.

    Parameters
    ----------
    diagram : Stabilisation
        Modes of every order.
    judged : sequence of JudgedMode
        Modes that recur. Those of the plant are shaded; neighbours of which one at most is the
        plant's are dashed lines.
    order : int
        Order of the chosen model.
    axes : matplotlib.axes.Axes or None
        Axes to draw on; None for a new figure.
    """
    axes = _new() if axes is None else axes
    for standing, settings in _LOOKS.items():
        for number, mode in enumerate(standing_as(standing, judged)):
            # Of several lines one is in the legend.
            label = "" if number else _LABELS[standing]
            axes.axvline(mode.frequency_hz, color="C0", label=label, **settings)
    for name, look, stays in (("new", "s", False), ("stays", "o", True)):
        seen = [each for each in diagram.poles if each.admissible and each.stable is stays]
        color = "black" if stays else "0.7"
        places = [each.frequency_hz for each in seen], [each.order for each in seen]
        axes.plot(*places, look, color=color, markersize=3, linestyle="none", label=name)
    axes.axhline(order, color="C1", linestyle="--", label=f"order {order}")
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("order")
    axes.legend(loc="upper right")
    return axes


def _new() -> Axes:
    from matplotlib import pyplot as plt  # noqa: PLC0415 - half a second, for who plots

    _, axes = plt.subplots(figsize=(9.0, 4.5), layout="constrained")
    return axes
