"""Pole plots: the z plane with the unit circle, and damping over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.axis import Axis
from flexarm_ident.report.plots.chart import Note, Panel, View, chart

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.models.modes import Mode, ModeUncertainty
    from flexarm_ident.report.plots.marks import Mark

_KINDS = ((False, "left out", marks.SQUARE), (True, "in the model", marks.DOT))
_SIDES = {1: "left", 0: "mid", -1: "right"}
_TICKED_SHARES = (0.1, 0.25, 0.5, 0.75)
_REACH = 1.3
_SIZE = "height:16rem"


def pole_plot(modes: Sequence[Mode], dt_s: float) -> str:
    """Plot the eigenvalues of a model in the z plane, with the unit circle.

    Parameters
    ----------
    modes : sequence of Mode
        All modes; the kept ones are highlighted.
    dt_s : float
        Sampling period, for the frequencies along the circle.
    """
    circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 181))
    ticks = np.exp(1j * np.pi * np.array(_TICKED_SHARES))
    found = [
        marks.Mark("line", marks.THIN, circle.real, circle.imag),
        marks.dots(ticks.real, ticks.imag, marks.SPECK),
    ]
    for kept, label, look in _KINDS:
        poles = np.array([mode.eigenvalue for mode in modes if mode.kept is kept])
        if len(poles):
            both = np.concatenate([poles, poles.conj()])
            found.append(marks.dots(both.real, both.imag, look, label))
    notes = [
        Note(
            1.06 * float(tick.real),
            1.06 * float(tick.imag),
            f"{0.5 * share / dt_s:.4g} Hz",
            _SIDES[int(np.sign(tick.real.round(3)))],
        )
        for share, tick in zip(_TICKED_SHARES, ticks, strict=True)
    ]
    reach = _REACH * max([1.0, *(abs(mode.eigenvalue) for mode in modes)])
    outside = sum(abs(mode.eigenvalue) >= 1.0 for mode in modes)
    panel = Panel(
        Axis("imaginary part of z", -reach, reach), found, "aspect-ratio:1;max-width:22rem", notes
    )
    words = f"poles of {len(modes)} modes, {outside} not inside the unit circle"
    return chart(View(words, Axis("real part of z", -reach, reach), [panel]))


def damping_plot(modes: Sequence[Mode], deviations: Sequence[ModeUncertainty] = ()) -> str:
    """Plot the damping ratio of each mode over its frequency, with a deviation to either side.

    Parameters
    ----------
    modes : sequence of Mode
        All modes; only those with a frequency are drawn.
    deviations : sequence of ModeUncertainty
        Scatter of each mode, or none. Bars end at the edge of the plot.
    """
    pairs = [(i, mode) for i, mode in enumerate(modes) if mode.frequency_hz > 0.0]
    frequencies_hz = np.array([mode.frequency_hz for _, mode in pairs])
    damping = np.array([mode.damping_ratio for _, mode in pairs])
    x = Axis.around("frequency, Hz", [frequencies_hz], log=True)
    y = Axis.around("damping ratio", [damping, [0.0]])
    found: list[Mark] = []
    if deviations:
        scatter = np.array(
            [(deviations[i].frequency_std_hz, deviations[i].damping_std) for i, _ in pairs]
        ).reshape(-1, 2)
        found.extend(_bars(frequencies_hz, damping, scatter))
    for kept, label, look in _KINDS:
        rows = [row for row, (_, mode) in enumerate(pairs) if mode.kept is kept]
        if rows:
            found.append(marks.dots(frequencies_hz[rows], damping[rows], look, label))
    words = f"damping ratio over frequency of {len(pairs)} modes"
    return chart(View(words, x, [Panel(y, found, _SIZE)]))


def _bars(
    frequencies_hz: FloatArray,
    damping: FloatArray,
    scatter: FloatArray,
) -> list[Mark]:
    """Return bars of one deviation to each side: (modes,), (modes,), (modes, 2)."""
    # A bar to zero has no place on a logarithmic axis.
    left_hz = frequencies_hz - np.minimum(scatter[:, 0], 0.99 * frequencies_hz)
    across = np.stack([left_hz, frequencies_hz + scatter[:, 0]], axis=1).ravel()
    up = np.stack([damping - scatter[:, 1], damping + scatter[:, 1]], axis=1).ravel()
    label = "one deviation"
    return [
        marks.segments(across, np.repeat(damping, 2), marks.WHISKER, label),
        marks.segments(np.repeat(frequencies_hz, 2), up, marks.WHISKER, label),
    ]
