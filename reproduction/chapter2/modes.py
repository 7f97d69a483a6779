"""Table 2-2 and Figure 2-16: the modes of the arm in the models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.modes import frequency_and_damping
from reproduction.chapter2.easier_rigs import easier_rig
from reproduction.chapter2.order_survey import (
    fitted_half,
    identified,
    model_of,
    prepared,
    printed_order,
    thesis_record,
)
from reproduction.framework.findings import (
    OFTEN,
    SEEDS,
    SENSORS,
    Call,
    Finding,
    Plot,
    SideBySide,
    columns,
    percent,
    prose,
    subject,
    thesis_table,
)
from reproduction.framework.plots import range_plot
from reproduction.framework.rig import run_experiment
from reproduction.framework.study_rig import study_rig
from reproduction.framework.verdicts import Beside, Judgement, all_of, judged, less, mostly

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control
    from numpy.typing import NDArray

    from reproduction.framework.findings import Results


FREQUENCIES_HZ = np.geomspace(0.5, 100.0, 400)
GAUGES = (1, 2)
CAPTURED = 0.15
"""A mode counts as captured when the model has it within this share: the thesis's own first mode of
the random waveform in Table 2-2 is 10 % off, and calls it captured."""
# Where the peak of a mode is looked for: nearer to it than to its neighbours.
_WINDOW = 1.3


def gains(model: control.StateSpace) -> NDArray[np.float64]:
    """Return the magnitudes at `FREQUENCIES_HZ`, (frequencies, 4)."""
    return np.asarray(np.abs(frequency_response(model, FREQUENCIES_HZ)[:, :, 0]))


def peak_hz(gain: NDArray[np.float64], near_hz: float) -> float:
    """Return the frequency, Hz, of a peak of (frequencies,) gains near another, or nan."""
    is_near = (near_hz / _WINDOW < FREQUENCIES_HZ) & (near_hz * _WINDOW > FREQUENCIES_HZ)
    inside = np.flatnonzero(is_near)
    highest = inside[np.argmax(gain[inside])]
    return np.nan if highest in (inside[0], inside[-1]) else float(FREQUENCIES_HZ[highest])


def has_peak(gain: NDArray[np.float64], near_hz: float) -> bool:
    """Return whether a gauge's gains, of (frequencies, 4), have a peak at a frequency, Hz."""
    return any(abs(peak_hz(gain[:, k], near_hz) / near_hz - 1.0) <= CAPTURED for k in GAUGES)


RECORDS = {
    "square": "O_dat2",
    "periodic random": "O_dat6",
    "varying square": "O_dat10",
    "random": "O_dat13",
}
"""Records at 300 Hz with 2 V; the thesis does not say which it took."""
MODES_HZ = natural_frequencies_hz(study_rig())
BETWEEN_HZ = np.sqrt(MODES_HZ[:-1] * MODES_HZ[1:])
"""Frequencies without a mode of the arm: what is found there is found by chance."""

_PRINTED = thesis_table("table_2_2")


@dataclass(frozen=True, eq=False)
class WaveformModes:
    """Modes of models with 27 states, per seed.

    Natural frequencies of the oscillating modes, the highest first, and the peaks of a gauge's
    response at `MODES_HZ`, (seeds, 3), and at `BETWEEN_HZ`, (seeds, 2).
    """

    frequencies_hz: tuple[tuple[float, ...], ...]
    peaks: NDArray[np.bool_]
    chance: NDArray[np.bool_]


def waveform_modes(record: str, friction: bool) -> WaveformModes:  # noqa: FBT001
    """Identify models with 27 states from an open-loop experiment, and find their modes."""
    rig = easier_rig(noise=True, friction=friction)
    frequencies_hz, peaks, chance = [], [], []
    for seed in SEEDS:
        whole = prepared(run_experiment(experiment(record), rig, seed))
        model, _ = model_of(identified(fitted_half(whole)), _PRINTED["order"])
        eigenvalues = np.linalg.eigvals(model.A)
        oscillating = eigenvalues[eigenvalues.imag > 0.0].tolist()
        found_hz = (frequency_and_damping(each, whole.dt_s)[0] for each in oscillating)
        frequencies_hz.append(tuple(sorted(found_hz, reverse=True)))
        response = gains(model)
        peaks.append([has_peak(response, mode) for mode in MODES_HZ])
        chance.append([has_peak(response, place) for place in BETWEEN_HZ])
    return WaveformModes(tuple(frequencies_hz), np.array(peaks), np.array(chance))


def nearest(frequencies_hz: Sequence[float], wanted_hz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the frequency that is nearest to each wanted one."""
    given = np.asarray(frequencies_hz, dtype=float)
    closest = np.abs(np.subtract.outer(wanted_hz, given)).argmin(axis=1)
    return np.asarray(given[closest])


def captured(found: WaveformModes, wanted_hz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell whether a natural frequency is near each wanted one, (seeds, wanted)."""
    near_hz = np.array([nearest(each, wanted_hz) for each in found.frequencies_hz])
    return np.asarray(np.abs(near_hz / wanted_hz - 1.0) <= CAPTURED)


def _of_waveforms(results: Results, *, friction: bool) -> dict[str, WaveformModes]:
    return {
        name: results[Call(waveform_modes, (record, friction))] for name, record in RECORDS.items()
    }


def _table(results: Results) -> Finding:
    found, free = (_of_waveforms(results, friction=friction) for friction in (True, False))
    printed_hz = np.array(_PRINTED["analytic_hz"], dtype=float)
    rows = tuple(
        (
            name,
            _numbers(nearest(_PRINTED[name], printed_hz)),
            _numbers(_nearest_hz(ours)),
            _shares(captured(ours, MODES_HZ)),
            _shares(captured(ours, BETWEEN_HZ)),
            _shares(ours.peaks),
            _shares(ours.chance),
        )
        for name, ours in found.items()
    )
    all_rows = tuple(
        (name, _numbers(_PRINTED[name]), _numbers(ours.frequencies_hz[0]))
        for name, ours in found.items()
    )
    modes, between = _numbers(MODES_HZ), _numbers(BETWEEN_HZ)
    frequencies = np.median([len(each) for ours in found.values() for each in ours.frequencies_hz])
    headings = columns(
        prose(
            "table-2-2.columns",
            printed_modes=" ".join(map(str, _PRINTED["analytic_hz"])),
            modes=modes,
            between=between,
        )
    )
    return Finding(
        modes_judgement(found, free),
        (
            SideBySide(f"Modes of the arm in the models, {len(SEEDS)} seeds", headings, rows),
            SideBySide("All frequencies, Hz", ("waveform", "thesis", "ours, seed 1"), all_rows),
        ),
        text=(
            prose(
                "table-2-2.text",
                modes=modes,
                printed_modes=" ".join(map(str, _PRINTED["analytic_hz"])),
                order=_PRINTED["order"],
                frequencies=frequencies,
                between=between,
                captured=CAPTURED,
            ),
        ),
    )


def modes_judgement(
    found: Mapping[str, WaveformModes], free: Mapping[str, WaveformModes]
) -> Judgement:
    """Judge Table 2-2: every waveform captures every mode, and not by chance.

    `free` comes from the rig without friction and gear play, for the reason.
    """
    near = {name: captured(each, MODES_HZ) for name, each in found.items()}
    absent, lost = (
        ", ".join(
            f"{name} mode {number} ({share:.0%})"
            for name, each in events.items()
            for number, share in enumerate(each.mean(axis=0), start=1)
            if share <= OFTEN
        )
        or "none"
        for events in (near, {name: each.peaks for name, each in found.items()})
    )
    peaks, chance = (
        np.mean([getattr(each, which).mean(axis=1) for each in found.values()], axis=0)
        for which in ("peaks", "chance")
    )
    printed_hz = np.array(_PRINTED["analytic_hz"], dtype=float)
    theirs = [hz for name in found for hz in nearest(_PRINTED[name], printed_hz).tolist()]
    ours = [hz for each in found.values() for hz in _nearest_hz(each).tolist()]
    return judged(
        figures=(Beside("frequencies", tuple(theirs), tuple(ours), 1.0 + CAPTURED),),
        statements=(
            all_of(
                "from every waveform an eigenvalue is near each mode",
                [
                    mostly(f"{name} mode {number}", column)
                    for name, each in near.items()
                    for number, column in enumerate(each.T, start=1)
                ],
            ),
            less("gauges have peaks at the modes rather than between them", chance, peaks),
        ),
        evidence=f"A gauge's response has a peak at a mode in {peaks.mean():.0%} of all cases, "
        f"between the modes in {chance.mean():.0%}. Peaks that are missing in most seeds: {lost}.",
        reason=prose(
            "table-2-2.reason",
            eigenvalues=np.mean([captured(each, MODES_HZ) for each in free.values()]),
            peaks=np.mean([each.peaks for each in free.values()]),
            absent=absent,
        ),
    )


def _nearest_hz(found: WaveformModes) -> NDArray[np.float64]:
    near_hz = [nearest(each, MODES_HZ) for each in found.frequencies_hz]
    return np.asarray(np.median(near_hz, axis=0))


def _numbers(values: Sequence[float] | NDArray[np.float64]) -> str:
    return " ".join(f"{each:.1f}" for each in values)


def _shares(found: NDArray[np.bool_]) -> str:
    return percent(found.mean(axis=0), " ")


RESPONSE_RECORD = "C_dat3"
LARGER_ORDER = 27
"""The order of Table 2-2: it tells whether a mode is missing in the record or in the order."""
_OTHERS = (0, 3)


def closed_loop_gains() -> dict[int, NDArray[np.float32]]:
    """Return the magnitudes of the models of the thesis's order and of a larger one.

    By order, (seeds, frequencies, 4).
    """
    orders = (printed_order(RESPONSE_RECORD), LARGER_ORDER)
    found: dict[int, list[NDArray[np.float64]]] = {order: [] for order in orders}
    for seed in SEEDS:
        identification = identified(fitted_half(thesis_record(RESPONSE_RECORD, seed)))
        for order in orders:
            found[order].append(gains(model_of(identification, order)[0]))
    return {order: np.array(some, dtype=np.float32) for order, some in found.items()}


def _response(results: Results) -> Finding:
    found = {
        order: np.asarray(some, dtype=float)
        for order, some in results[Call(closed_loop_gains)].items()
    }
    order = printed_order(RESPONSE_RECORD)
    peaks = {
        each: np.array([[has_peak(gain, mode) for mode in MODES_HZ] for gain in some])
        for each, some in found.items()
    }
    shares = {each: some.mean(axis=0) for each, some in peaks.items()}
    at_modes = [int(np.argmin(np.abs(FREQUENCIES_HZ - mode))) for mode in MODES_HZ]
    strength = np.median(found[order][:, at_modes], axis=0)
    rows = tuple(
        (
            f"{mode:.1f}",
            *(f"{shares[each][k]:.0%}" for each in found),
            *(f"{strength[k, channel]:.3f}" for channel in range(len(SENSORS))),
        )
        for k, mode in enumerate(MODES_HZ)
    )
    headings = (
        "mode of our beam, Hz",
        *(f"peak in a gauge, {each} states" for each in found),
        *(f"{name}, V/V" for name in SENSORS),
    )
    return Finding(
        response_judgement(peaks[order], shares[LARGER_ORDER], found[order][:, at_modes]),
        (SideBySide(f"Modes in the response, {len(SEEDS)} seeds", headings, rows),),
        tuple(
            Plot(
                f"Gain to the {name}, {order} states: median and range over {len(SEEDS)} seeds",
                range_plot(FREQUENCIES_HZ, found[order][:, :, channel], name),
            )
            for channel, name in enumerate(SENSORS)
        ),
        (
            prose(
                "figure-2-16.text", order=order, response_record=RESPONSE_RECORD, captured=CAPTURED
            ),
        ),
    )


def response_judgement(
    peaks: NDArray[np.bool_], larger: Sequence[float], strength: NDArray[np.float64]
) -> Judgement:
    """Judge Figure 2-16 by peaks, (seeds, modes), and gains, (seeds, modes, 4).

    `larger` are the shares of the seeds with a peak when the model has `LARGER_ORDER` states.
    """
    gauges, others = strength[:, :, GAUGES].min(axis=2), strength[:, :, _OTHERS].max(axis=2)
    return judged(
        statements=(
            all_of(
                "a gauge has a peak at each mode",
                [mostly(f"mode {number}", each) for number, each in enumerate(peaks.T, start=1)],
            ),
            all_of(
                "the modes are stronger in both gauges than in position and speed",
                [
                    less(f"mode {number}", *pair)
                    for number, pair in enumerate(zip(others.T, gauges.T, strict=True), start=1)
                ],
            ),
        ),
        evidence=f"Peaks at the modes: in {percent(peaks.mean(axis=0))} of the seeds with the "
        f"thesis's order, in {percent(larger)} with {LARGER_ORDER} states.",
        reason="Noise as strong as this leaves too little of the modes in a model of this order.",
    )


SUBJECTS = (
    subject(
        "table-2-2",
        tuple(
            Call(waveform_modes, (record, friction))
            for friction in (True, False)
            for record in RECORDS.values()
        ),
        _table,
    ),
    subject("figure-2-16", (Call(closed_loop_gains),), _response),
)
