"""Figures 3-8, 3-26 and 3-27: frequency responses of updated models, and of a forced one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import control
import matplotlib as mpl
import numpy as np
from scipy import signal

from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.modes import frequency_grid
from reproduction.chapter3.trial import both_calls, records_of
from reproduction.framework.findings import (
    SENSORS,
    Finding,
    Plot,
    Subject,
    prose,
    subject,
)
from reproduction.framework.picture import (
    BLACK,
    BLUE,
    MARK,
    STYLE,
    VERMILION,
    figure_of,
    inline_svg,
    legend_above,
    plain_numbers,
)
from reproduction.framework.verdicts import judged, mostly

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from reproduction.chapter3.examples import Matrices, Records


PEAK_DB = 3.0
"""A local maximum of this prominence is a peak."""
PEAK_NEAR = 0.1
"""A peak belongs to a bending mode within a tenth of its frequency."""
_RATE_HZ = 300.0
_LOWEST_HZ = 0.05
# As the thesis draws them: position, base gauge, middle gauge, speed.
_LOOKS: Any = (
    {"color": MARK, "linestyle": "-."},
    {"color": BLUE, "linestyle": "-"},
    {"color": BLACK, "linestyle": "--"},
    {"color": VERMILION, "linestyle": ":"},
)


def gains_db(matrices: Matrices, frequencies_hz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the gains of a model to its outputs, (frequencies, outputs)."""
    gain = np.abs(frequency_response(_model(matrices), frequencies_hz)[:, :, 0])
    return np.asarray(20.0 * np.log10(np.maximum(gain, np.finfo(float).tiny)))


def peaks_hz(matrices: Matrices, known_hz: Sequence[float]) -> tuple[float, ...]:
    """Return the frequencies, Hz, of the peaks of either gauge that belong to known modes."""
    grid = frequency_grid(_model(matrices), _LOWEST_HZ)
    gauges = gains_db(matrices, grid)[:, 1:3]
    peaks = np.sort(
        np.concatenate(
            [grid[signal.find_peaks(gauge, prominence=PEAK_DB)[0]] for gauge in gauges.T]
        )
    )
    found = []
    for hz in known_hz:
        near = peaks[np.abs(peaks / hz - 1.0) <= PEAK_NEAR]
        if len(near):
            found.append(float(near[np.argmin(np.abs(np.log(near / hz)))]))
    return tuple(found)


def compare_responses(found: Records) -> Finding:
    """Draw the responses of an updated model and find its bending modes with little noise."""
    example, low, noisy = found
    shown = found.shown(noisy=False)
    matrices = shown.models["updated"]
    known = example.known_modes_hz
    peaks = peaks_hz(matrices, known)
    whole, whole_noisy = (
        sum(len(trial.stages["updated"].bending_hz) == len(known) for trial in some)
        for some in (low, noisy)
    )
    listed = " / ".join(f"{hz:.1f}" for hz in peaks) or "none"
    beam = " / ".join(f"{hz:.1f}" for hz in known)
    return Finding(
        judged(
            statements=(
                mostly(
                    "the updated model has all three flexible modes",
                    [len(trial.stages["updated"].bending_hz) == len(known) for trial in low],
                ),
            ),
            evidence=f"With little noise it has in {whole} of {len(low)} records. {len(peaks)} of "
            f"{len(known)} stand out of the gauges' responses of the record that is shown by "
            f"{PEAK_DB:g} dB or more, at {listed} Hz (the rig's arm: {beam} Hz).",
            reason="The identified model has no such mode.",
        ),
        plots=(
            Plot(
                f"Gains of the updated model, {shown.stages['updated'].order} states",
                _plot(matrices, known, "frequency responses of the updated model"),
            ),
        ),
        text=(
            prose(
                "figure-3-8.text",
                record=example.experiment,
                seed=shown.seed,
                whole_noisy=whole_noisy,
                records=len(noisy),
            ),
        ),
    )


def _model(matrices: Matrices) -> control.StateSpace:
    A, B, C = matrices
    return control.ss(A, B, C, np.zeros((len(C), B.shape[1])), 1.0 / _RATE_HZ)


def _plot(matrices: Matrices, known_hz: Sequence[float], description: str) -> str:
    grid = frequency_grid(_model(matrices), _LOWEST_HZ)
    with mpl.rc_context(STYLE):
        figure = figure_of(3.0)
        axes = figure.subplots()
        for hz in known_hz:
            axes.axvline(hz, color=VERMILION, linewidth=0.5)
        for sensor, gain, look in zip(SENSORS, gains_db(matrices, grid).T, _LOOKS, strict=True):
            axes.plot(grid, gain, label=sensor, linewidth=1.3, **look)
        axes.set(xlabel="frequency, Hz", ylabel="gain, dB (V/V)", xscale="log")
        axes.set_xlim(grid[0], grid[-1])
        axes.xaxis.set_major_formatter(plain_numbers())
        legend_above(axes, columns=2)
        return inline_svg(figure, description)


def _subject(key: str, code: str, compare: Callable[[Records], Finding]) -> Subject:
    return subject(key, both_calls(code), lambda results: compare(records_of(results, code)))


SUBJECTS = (
    _subject("figure-3-8", "Ac3_18", compare_responses),
    _subject("figure-3-26", "Ac3_21u", compare_responses),
)
