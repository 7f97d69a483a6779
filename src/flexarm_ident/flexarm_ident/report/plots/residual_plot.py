"""Residual plot: correlation of a residual with itself and with the inputs, with bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.plots.style import (
    DASHED,
    DOTTED,
    SHADE,
    SOLID,
    STYLE,
    figure_of,
    inline_svg,
    legend_above,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.fitting.residuals import Residuals

_LOOKS = (SOLID, DASHED, DOTTED)
RESIDUAL_INPUTS = len(_LOOKS)
"""Inputs that a plot shows."""


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
    with mpl.rc_context(STYLE):
        figure = figure_of(3.2)
        own, cross = figure.subplots(2)
        own.axhspan(-found.own_bound, found.own_bound, color=SHADE, linewidth=0.0)
        own.plot(found.own_lags, found.own[:, output], **SOLID)
        own.set(ylabel="with itself", xlim=(0.0, found.own_lags[-1]))
        bound = max(found.cross_bound[output, number] for number, _, _ in shown)
        cross.axhspan(-bound, bound, color=SHADE, linewidth=0.0, label="by chance (99 %)")
        for number, source, look in shown:
            label = label_and_unit(source)[0]
            cross.plot(found.lags, found.cross[:, output, number], label=label, **look)
        cross.set(xlabel="lag, samples", ylabel="with inputs")
        cross.set_xlim(found.lags[0], found.lags[-1])
        legend_above(cross)
        return inline_svg(figure, f"{label_and_unit(name)[0]}: correlation of the residual")
