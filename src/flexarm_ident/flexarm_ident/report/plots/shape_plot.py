"""Mode shape plot: what each output has of one mode, in phase and a quarter period apart.

The script of the page moves the bars through a period by the amplitudes that are written here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.axis import Axis
from flexarm_ident.report.plots.chart import Note, Panel, View, chart

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.models.mode_shapes import ModeShape

_SIZE = "height:9rem"
_HALF_WIDTH = 0.3
_LOW, _HIGH = -1.45, 1.15
_NAMES_AT = -1.4


def shape_plot(shape: ModeShape, outputs: Sequence[str]) -> str:
    """Plot the shape of a mode, a bar for each output.

    Parameters
    ----------
    shape : ModeShape
        The shape.
    outputs : sequence of str
        Names of the outputs.
    """
    place = np.arange(1.0, len(outputs) + 1.0)
    gap = np.full(len(place), np.nan)
    left, right, zero = place - _HALF_WIDTH, place + _HALF_WIDTH, np.zeros(len(place))
    across = np.stack([left, left, right, right, gap], axis=1).ravel()
    real, imaginary = shape.values.real, shape.values.imag
    up = np.stack([zero, real, real, zero, gap], axis=1).ravel()
    low, high = 0.5, len(place) + 0.5
    found = [
        marks.Mark("area", marks.BAND, across, up, "in phase"),
        marks.line([low, high], [0.0, 0.0], marks.THIN),
        marks.dots(place, imaginary, marks.DOT, "a quarter period ahead"),
    ]
    names = [label_and_unit(name)[0] for name in outputs]
    notes = [Note(float(i), _NAMES_AT, name) for i, name in zip(place, names, strict=True)]
    words = f"shape of the mode at {shape.frequency_hz:.4g} Hz over {len(names)} outputs"
    panel = Panel(Axis("amplitude", _LOW, _HIGH, step=0.5), found, _SIZE, notes)
    # Names stand in the place of ticks: no multiple of that step lies on the axis.
    drawn = chart(View(words, Axis("", low, high, step=2.0 * len(place)), [panel]))
    parts = np.stack([real, imaginary], axis=1).ravel()
    amplitudes = " ".join(f"{part:.4f}" for part in parts)
    return f'<div class="shape" data-shape="{amplitudes}">{drawn}</div>'
