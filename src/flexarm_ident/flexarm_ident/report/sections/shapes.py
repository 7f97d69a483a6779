"""Modes sections: modes of the full model, and how the sensors move in each oscillating one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import decay, label_and_unit, with_deviation
from flexarm_ident.fitting.validation import rms
from flexarm_ident.models.modes import mode_shapes
from flexarm_ident.report.content.blocks import Plots, Section, Table, Words
from flexarm_ident.report.content.wording import deviation_words
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Note, Panel, View, chart
from flexarm_ident.report.plots.marks import Axis, plain

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_ident.models.modes import ModeShape
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

# With many outputs the bars of a plot have no room for their names.
_SHAPES, _OUTPUTS = 6, 6
_HALF_TURN = 180
_TWO_DECIMALS = 0.1
_SIZE = "height:9rem"
_HALF_WIDTH = 0.3
_LOW, _HIGH = -1.45, 1.15
_NAMES_AT = -1.4
_LARGE = 1e3


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
    """Return an amplitude with two decimals, a smaller one with two digits: 0: no motion."""
    return f"{magnitude:.2f}" if magnitude >= _TWO_DECIMALS else f"{magnitude:.2g}"


def _whole_degrees(phase: float) -> str:
    """Return a phase from -179 to 180."""
    degrees = round(phase) % 360
    return plain(degrees if degrees <= _HALF_TURN else degrees - 2 * _HALF_TURN)


def _applies(subject: Subject) -> bool:
    model = subject.outcome.model
    return model.noutputs > 1 and bool(mode_shapes(model, np.ones(model.noutputs)))


SECTION = Section(35, "Mode shapes", _build, _applies)


def shape_plot(shape: ModeShape, outputs: Sequence[str]) -> str:
    """Plot the shape of a mode, a bar for each output.

    The script of the page moves the bars through a period by the amplitudes written here.

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


def _listed(subject: Subject) -> Iterator[Block]:
    table = _modes(subject.outcome)
    yield table
    marked = " The marked modes are the reduced model." if table.marked else ""
    yield Words(
        "These are the modes of the full model. MSV is the weight of a mode in a pulse response, "
        "MRM its mean response to the recorded input; rank 1 is the largest. A mode that "
        "does not oscillate has its time constant in place of a frequency. A negative damping "
        "ratio is an unstable mode. "
        f"{deviation_words(subject.outcome)}{marked}"
    )


MODES = Section(30, "Modes", _listed)


def _modes(outcome: Outcome) -> Table:
    """Return the modes of the full model, as Tables 3-1a to 3-3a."""
    header = ("States", "Frequency, Hz", "Damping", "MSV (rank)", "MRM (rank)", "Kept")
    deviations = outcome.identification.known_deviations or [None] * len(outcome.modes)
    rows = tuple(
        (
            mode.label,
            decay(mode.eigenvalue, outcome.model.dt)
            or with_deviation(mode.frequency_hz, deviation and deviation.frequency_std_hz),
            # Without a frequency it is 1 by definition.
            with_deviation(mode.damping_ratio, (deviation and deviation.damping_std) or None),
            f"{_index(mode.msv)} ({mode.msv_rank})",
            f"{_index(mode.mrm)} ({mode.mrm_rank})",
            "yes" if mode.kept else "no",
        )
        for mode, deviation in zip(outcome.modes, deviations, strict=True)
    )
    kept = tuple(mode.kept for mode in outcome.modes)
    marked = () if all(kept) else kept
    return Table("modes", "Modes of the full model", header, rows, marked)


def _index(value: float) -> str:
    return f"{value:.3f}" if value < _LARGE else f"{value:.1e}"
