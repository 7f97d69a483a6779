"""Mode shapes section: how the sensors move against each other in each oscillating mode."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.fitting.validation import rms
from flexarm_ident.models.mode_shapes import mode_shapes
from flexarm_ident.report.content.blocks import Plots, Section, Table, Words
from flexarm_ident.report.plots.axis import plain
from flexarm_ident.report.plots.shape_plot import shape_plot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.models.mode_shapes import ModeShape
    from flexarm_ident.report.content.blocks import Block, Subject

# With many outputs the bars of a plot have no room for their names.
_SHAPES, _OUTPUTS = 6, 6
_HALF_TURN = 180
_TWO_DECIMALS = 0.1


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    level = rms(np.vstack([record.y_measured for record in outcome.records]))
    scale = np.divide(1.0, level, out=np.ones_like(level), where=level > 0.0)
    shapes, outputs = mode_shapes(outcome.model, scale), outcome.records[0].outputs
    if len(outputs) <= _OUTPUTS:
        yield Plots(
            tuple(
                (f"{shape.frequency_hz:.4g} Hz", shape_plot(shape, outputs))
                for shape in shapes[:_SHAPES]
            )
        )
    header = ("Frequency, Hz", *(label_and_unit(name)[0] for name in outputs))
    yield Table("shapes", "Shapes of the modes", header, tuple(map(_row, shapes)))
    more = f" The plots show the first {_SHAPES}." if len(shapes) > _SHAPES else ""
    yield Words(
        "These are the oscillating modes of the model. In each, the output that moves most has the "
        "amplitude 1 and the phase 0°; each output is measured by its own RMS over the record. "
        "Outputs whose phases differ by 0° move together, by 180° against each other. A rate, such "
        "as a speed, is about 90°, a quarter period, ahead of its position."
        f"{more}"
    )


def _row(shape: ModeShape) -> tuple[str, ...]:
    pairs = zip(shape.magnitude, shape.phase_deg, strict=True)
    cells = (f"{_size(size)}, {_whole_degrees(phase)}°" for size, phase in pairs)
    return (f"{shape.frequency_hz:.3f}", *cells)


def _size(magnitude: float) -> str:
    """Return an amplitude with two decimals, a smaller one with two digits: zero is no motion."""
    return f"{magnitude:.2f}" if magnitude >= _TWO_DECIMALS else f"{magnitude:.2g}"


def _whole_degrees(phase: float) -> str:
    """Return a phase from -179 to 180."""
    degrees = round(phase) % 360
    return plain(degrees if degrees <= _HALF_TURN else degrees - 2 * _HALF_TURN)


def _applies(subject: Subject) -> bool:
    model = subject.outcome.model
    return model.noutputs > 1 and bool(mode_shapes(model, np.ones(model.noutputs)))


SECTION = Section(35, "Mode shapes", _build, _applies)
