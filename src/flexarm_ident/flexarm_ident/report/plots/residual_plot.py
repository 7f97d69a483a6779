"""Residual plot: correlation of a residual with itself and with the inputs, with bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.axis import Axis
from flexarm_ident.report.plots.chart import Panel, View, chart

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.fitting.residuals import Residuals

_LOOKS = (marks.SOLID, marks.DASHED, marks.DOTTED)
RESIDUAL_INPUTS = len(_LOOKS)
"""Inputs that a plot shows."""
_SIZE = "height:6.5rem"
_CHANCE = "by chance (99 %)"


def residual_plot(found: Residuals, output: int, name: str, inputs: Sequence[str]) -> str:
    """Plot the correlations of one output's residual; the bounds are shaded.

    Parameters
    ----------
    found : Residuals
        The correlations.
    output : int
        Number of the output, from 0.
    name : str
        Its name.
    inputs : sequence of str
        Names of the inputs; the first three are shown.
    """
    shown = list(zip(range(len(inputs)), inputs, _LOOKS, strict=False))
    words = f"{label_and_unit(name)[0]}: correlation of the residual"
    own_ends, ends = [0.0, found.own_lags[-1]], [found.lags[0], found.lags[-1]]
    own_bound = found.own_bound
    bound = max(found.cross_bound[output, number] for number, _, _ in shown)
    own = [
        marks.between(own_ends, -own_bound, own_bound, marks.SHADE, _CHANCE),
        marks.line(found.own_lags, found.own[:, output], marks.SOLID, "with itself"),
    ]
    cross = [marks.between(ends, -bound, bound, marks.SHADE, _CHANCE)] + [
        marks.line(
            found.lags,
            found.cross[:, output, number],
            look,
            f"with {label_and_unit(source)[0]}",
        )
        for number, source, look in shown
    ]
    return chart(
        *(
            View(
                words,
                Axis("lag, samples", float(limits[0]), float(limits[1])),
                [Panel(Axis.around(label, [each.y for each in panel]), panel, _SIZE)],
            )
            for label, limits, panel in (
                ("with inputs", ends, cross),
                ("with itself", own_ends, own),
            )
        )
    )
