"""Curves over time, one panel below the other, with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray

LOOKS: tuple[dict[str, Any], ...] = (
    {"color": "C0", "linewidth": 1.4},
    {"color": "black", "linewidth": 1.0, "linestyle": "--"},
    {"color": "C1", "linewidth": 1.4, "linestyle": ":"},
)
"""Looks of the first, second and third curve: told apart without colours too."""
_WIDTH_IN, _PANEL_IN = 9.0, 1.7


class Panel(NamedTuple):
    """Curves over one vertical axis: its label, and each with its name, which may be empty."""

    label: str
    curves: Sequence[tuple[str, FloatArray]]


def plot_traces(time_s: FloatArray, panels: Sequence[Panel]) -> NDArray[np.object_]:
    """Plot curves over time.

    Parameters
    ----------
    time_s : ndarray, (samples,)
        Instants.
    panels : sequence of Panel
        Panels from above, with three curves of `samples` each at most. A curve breaks off at NaN.

    Returns
    -------
    ndarray of matplotlib.axes.Axes, (panels,)
        The axes, to draw on and to save: `axes[0].figure.savefig("run.pdf")`.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415 - half a second, for who plots

    size = (_WIDTH_IN, _PANEL_IN * len(panels) + 0.4)
    _, grid = plt.subplots(
        len(panels), 1, sharex=True, squeeze=False, figsize=size, layout="constrained"
    )
    axes: NDArray[np.object_] = grid[:, 0]
    for place, panel in zip(axes, panels, strict=True):
        _draw(place, time_s, panel)
    axes[-1].set_xlabel("time, s")
    return axes


def _draw(axes: Axes, time_s: FloatArray, panel: Panel) -> None:
    for (name, values), look in zip(panel.curves, LOOKS, strict=False):
        axes.plot(time_s, values, label=name or None, **look)
    axes.set_ylabel(panel.label)
    axes.margins(x=0.0)
    axes.grid(alpha=0.3)
    if any(name for name, _ in panel.curves):
        axes.legend(loc="upper right")
