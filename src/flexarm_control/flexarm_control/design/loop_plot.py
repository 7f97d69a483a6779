"""Plot of loops over the frequency: sensitivity, complementary sensitivity and open loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.margins import LOWEST_HZ
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_control.design.margins import Loop
    from flexarm_core.arrays import ComplexArray

_POINTS = 400
# Slower than the loops, below the frequencies that count for margins.
_START = 0.1
_CURVES: dict[str, Callable[[Loop], ComplexArray]] = {
    "sensitivity": lambda loop: loop.sensitivity,
    "complementary sensitivity": lambda loop: 1.0 - loop.sensitivity,
    "open loop": lambda loop: loop.response,
}


def loop_plot(loops: Mapping[str, Loop]) -> str:
    """Plot the magnitudes of at most two loops of one model, by the names of their controllers."""
    frequency_hz = next(iter(loops.values())).frequency_hz
    wanted_hz = np.geomspace(_START * LOWEST_HZ, frequency_hz[-1], _POINTS)
    rows = np.unique(np.searchsorted(frequency_hz, wanted_hz))
    panels = []
    for title, curve in _CURVES.items():
        sizes = [np.abs(curve(loop))[rows] for loop in loops.values()]
        lines = [
            marks.line(frequency_hz[rows], size, look, name)
            for name, size, look in zip(loops, sizes, (marks.SOLID, marks.DASHED), strict=False)
        ]
        panels.append(Panel(Axis.around(title, sizes, log=True), lines))
    x = Axis.around("frequency, Hz", [frequency_hz[rows]], log=True)
    return chart(View("magnitude of the loop over frequency", x, panels))
