"""Poles section: poles of the model."""

from __future__ import annotations

import math
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.content.blocks import Plots, Section, Words
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Note, Panel, View, chart
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.models.modes import Mode, ModeUncertainty
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.report.plots.marks import Mark
    from flexarm_ident.workflow.outcome import Outcome

# More maps than these are a page of their own.
_CHANNELS = 6
_KINDS = ((False, "left out", marks.SQUARE), (True, "in the model", marks.DOT))
_SIDES = {1: "left", 0: "mid", -1: "right"}
_TICKED_SHARES = (0.1, 0.25, 0.5, 0.75)
_REACH = 1.3
# A zero far outside would leave the poles one dot.
_FURTHEST = 2.0
_SIZE = "height:16rem"
_ELLIPSE = "95 % confidence"
# Of the chi-squared distribution with two degrees of freedom.
_RADIUS = math.sqrt(-2.0 * math.log(0.05))
_TURN = np.linspace(0.0, 2.0 * np.pi, 33)


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    modes, deviations = outcome.modes, outcome.identification.known_deviations
    yield Plots(
        (
            ("z plane with the unit circle", pole_plot(modes, outcome.model.dt, deviations)),
            ("Damping over frequency", damping_plot(modes, deviations)),
        )
    )
    yield Words(
        "A pole outside the unit circle is unstable. Slow poles lie near 1, poles at half the "
        "sampling rate near -1."
    )
    yield Plots(tuple(islice(_pole_zero_maps(outcome), _CHANNELS)))
    yield Words(
        "These are poles and zeros of the model from one input to one output. A zero near a pole "
        "nearly cancels it in that output. A zero outside the unit circle, apart from the sampling "
        "zeros near -1, limits the bandwidth of a controller of that output "
        "(non-minimum phase)."
    )


def _pole_zero_maps(outcome: Outcome) -> Iterator[tuple[str, str]]:
    record, model = outcome.records[0], outcome.model
    for i, output in enumerate(record.outputs):
        for j, drive in enumerate(record.inputs):
            channel = model[i, j]
            names = " from ".join(label_and_unit(name)[0] for name in (output, drive))
            yield names, pole_zero_plot(channel.poles(), channel.zeros(), model.dt)


SECTION = Section(40, "Poles", _build)


def pole_plot(
    modes: Sequence[Mode], dt_s: float, deviations: Sequence[ModeUncertainty] = ()
) -> str:
    """Plot the eigenvalues of a model in the z plane, with the unit circle.

    Parameters
    ----------
    modes : sequence of Mode
        All modes; the kept ones are highlighted.
    dt_s : float
        Sampling period, for the frequencies along the circle.
    deviations : sequence of ModeUncertainty
        Scatter of each mode, drawn as ellipses, or none.
    """
    found: list[Mark] = []
    ellipses = [
        np.exp(dt_s * 2.0 * np.pi * hz * (1j * np.sqrt(1.0 - damping**2 + 0j) - damping))
        for hz, damping in map(_ellipse, deviations)
        if hz[0] > 0.0
    ]
    for side in (np.asarray, np.conj):
        found.extend(_areas([(z.real, z.imag) for z in map(side, ellipses)]))
    for kept, label, look in _KINDS:
        poles = np.array([mode.eigenvalue for mode in modes if mode.kept is kept])
        if len(poles):
            found.append(_pairs(poles, look, label))
    reach = max([1.0, *(abs(mode.eigenvalue) for mode in modes)])
    outside = sum(abs(mode.eigenvalue) >= 1.0 for mode in modes)
    words = f"poles of {len(modes)} modes, {outside} not inside the unit circle"
    return _z_plane(words, found, dt_s, reach)


def pole_zero_plot(poles: ComplexArray, zeros: ComplexArray, dt_s: float) -> str:
    """Plot poles and zeros of one channel of a model in the z plane.

    Parameters
    ----------
    poles, zeros : ndarray
        Poles and finite zeros, both of each pair. Zeros beyond twice the unit circle lie outside
        of the plot.
    dt_s : float
        Sampling period.
    """
    found = [marks.dots(zeros.real, zeros.imag, look, "zeros") for look in (marks.RING, marks.CORE)]
    found.append(marks.dots(poles.real, poles.imag, marks.SMALL, "poles"))
    reach = max([1.0, *np.abs(poles), *np.abs(zeros)[np.abs(zeros) < _FURTHEST]])
    words = f"{len(poles)} poles and {len(zeros)} zeros in the z plane"
    return _z_plane(words, found, dt_s, float(reach))


def damping_plot(modes: Sequence[Mode], deviations: Sequence[ModeUncertainty] = ()) -> str:
    """Plot the damping ratio of each mode over its frequency, with ellipses of its scatter.

    Parameters
    ----------
    modes : sequence of Mode
        All modes; only those with a frequency are drawn.
    deviations : sequence of ModeUncertainty
        Scatter of each mode, or none. Ellipses end at the edge of the plot.
    """
    oscillating = [mode for mode in modes if mode.frequency_hz > 0.0]
    frequencies_hz = np.array([mode.frequency_hz for mode in oscillating])
    damping = np.array([mode.damping_ratio for mode in oscillating])
    x = Axis.around("frequency, Hz", [frequencies_hz], log=True)
    y = Axis.around("damping ratio", [damping, [0.0]])
    found = _areas([_ellipse(each) for each in deviations if each.frequency_hz > 0.0])
    for kept, label, look in _KINDS:
        rows = [row for row, mode in enumerate(oscillating) if mode.kept is kept]
        if rows:
            found.append(marks.dots(frequencies_hz[rows], damping[rows], look, label))
    words = f"damping ratio over frequency of {len(oscillating)} modes"
    return chart(View(words, x, [Panel(y, found, _SIZE)]))


def _ellipse(mode: ModeUncertainty) -> tuple[FloatArray, FloatArray]:
    """Return frequency and damping ratio around a mode, where both scatter on their own."""
    frequency_hz = mode.frequency_hz + _RADIUS * mode.frequency_std_hz * np.cos(_TURN)
    damping = mode.damping_ratio + _RADIUS * mode.damping_std * np.sin(_TURN)
    # Zero has no place on a logarithmic axis, nor has a pair without a frequency in the z plane.
    return np.maximum(frequency_hz, 0.01 * mode.frequency_hz), damping


def _areas(outlines: Sequence[tuple[FloatArray, FloatArray]]) -> list[Mark]:
    return [marks.Mark("area", marks.BAND, x, y, _ELLIPSE) for x, y in outlines]


def _pairs(upper: ComplexArray, look: str, label: str) -> Mark:
    both = np.concatenate([upper, upper.conj()])
    return marks.dots(both.real, both.imag, look, label)


def _z_plane(words: str, found: Sequence[Mark], dt_s: float, reach: float) -> str:
    """Draw marks behind and within the unit circle, which shows the frequencies."""
    circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 181))
    ticks = np.exp(1j * np.pi * np.array(_TICKED_SHARES))
    behind = [
        marks.Mark("line", marks.THIN, circle.real, circle.imag),
        marks.dots(ticks.real, ticks.imag, marks.SPECK),
    ]
    notes = [
        Note(
            1.06 * float(tick.real),
            1.06 * float(tick.imag),
            f"{0.5 * share / dt_s:.4g} Hz",
            _SIDES[int(np.sign(tick.real.round(3)))],
        )
        for share, tick in zip(_TICKED_SHARES, ticks, strict=True)
    ]
    end = _REACH * reach
    y = Axis("imaginary part of z", -end, end)
    panel = Panel(y, [*behind, *found], "aspect-ratio:1;max-width:22rem", notes)
    return chart(View(words, Axis("real part of z", -end, end), [panel]))
