"""Table 2-2: whether models from each waveform have the first three modes of the arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq import RigParameters
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident.models.modes import frequency_and_damping
from reproduction.chapter2.gauge_peaks import CAPTURED, gains, has_peak
from reproduction.chapter2.order_survey import fitted_half, identified, model_of, thesis_record
from reproduction.framework.evidence import LEVEL, OFTEN, SEEDS, p_text, sign_test
from reproduction.framework.findings import Finding, Judgement, SideBySide, judged
from reproduction.framework.subjects import Call, Subject
from reproduction.framework.thesis_values import thesis_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from reproduction.framework.subjects import Results

RECORDS = {
    "square": "O_dat2",
    "periodic random": "O_dat6",
    "varying square": "O_dat10",
    "random": "O_dat13",
}
"""Records at 300 Hz with 2 V; the thesis does not say which it took."""
MODES_HZ = natural_frequencies_hz(RigParameters())
BETWEEN_HZ = np.sqrt(MODES_HZ[:-1] * MODES_HZ[1:])
"""Where the arm has no mode: how often something passes for one by chance."""

_PRINTED = thesis_table("table_2_2")


@dataclass(frozen=True, eq=False)
class WaveformModes:
    """Modes of models with 27 states, per seed.

    Attributes
    ----------
    frequencies_hz
        Natural frequencies of the oscillating modes, the highest first.
    peaks : ndarray, (seeds, 3)
        Whether the response of a gauge has a peak at each of `MODES_HZ`.
    chance : ndarray, (seeds, 2)
        The same for `BETWEEN_HZ`.
    """

    frequencies_hz: tuple[tuple[float, ...], ...]
    peaks: NDArray[np.bool_]
    chance: NDArray[np.bool_]


def waveform_modes(record: str) -> WaveformModes:
    """Identify models with 27 states from an experiment, and find their modes."""
    frequencies_hz, peaks, chance = [], [], []
    for seed in SEEDS:
        whole = thesis_record(record, seed)
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


def _table(results: Results) -> Finding:
    found = {name: results[Call(waveform_modes, (record,))] for name, record in RECORDS.items()}
    printed_hz = np.array(_PRINTED["analytic_hz"], dtype=float)
    rows = tuple(
        (
            name,
            _numbers(nearest(_PRINTED[name], printed_hz)),
            _numbers(np.median([nearest(each, MODES_HZ) for each in ours.frequencies_hz], axis=0)),
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
    headings = (
        "waveform",
        "nearest to 9 25 48 Hz, thesis",
        f"nearest to {modes} Hz, ours",
        "an eigenvalue there",
        f"an eigenvalue at {between} Hz",
        "a peak at the modes",
        f"a peak at {between} Hz",
    )
    return Finding(
        modes_judgement(found),
        (
            SideBySide("Modes of the arm in the models, 20 seeds", headings, rows),
            SideBySide("All frequencies, Hz", ("waveform", "thesis", "ours, seed 1"), all_rows),
        ),
        text=(
            (
                f"The modes of our beam are at {modes} Hz, those of the thesis's at 9, 25 and "
                "48 Hz. A model with 27 states has a dozen frequencies between 0 and 60 Hz, so "
                "that one of them is near a mode says nothing: one is as often near "
                f"{between} Hz, where the arm has none. So ours are also judged by what such a "
                "frequency does: whether the response of a gauge has a peak there. Near is within "
                f"{CAPTURED:.0%}; noise as strong as the thesis's."
            ),
        ),
    )


def modes_judgement(found: Mapping[str, WaveformModes]) -> Judgement:
    """Judge Table 2-2: every waveform captures every mode, and not by chance."""
    listed = all(
        bool(np.all(captured(each, MODES_HZ).mean(axis=0) > OFTEN)) for each in found.values()
    )
    lost = [
        f"{name} mode {number} ({share:.0%})"
        for name, each in found.items()
        for number, share in enumerate(each.peaks.mean(axis=0), start=1)
        if share <= OFTEN
    ]
    peaks = np.mean([each.peaks.mean(axis=1) for each in found.values()], axis=0)
    chance = np.mean([each.chance.mean(axis=1) for each in found.values()], axis=0)
    p_value = sign_test(chance, peaks)
    return judged(
        agrees=listed and not lost,
        same_ranking=listed and p_value < LEVEL,
        evidence=(
            f"An eigenvalue is near each mode in most seeds {'' if listed else 'not '}from each "
            f"waveform, as in the thesis's table. A gauge's response has a peak at a mode in "
            f"{peaks.mean():.0%} of all cases, between the modes in {chance.mean():.0%} "
            f"({p_text(p_value)}). "
            + (
                f"Peaks that are missing in most seeds: {', '.join(lost)}."
                if lost
                else "Every waveform brings out all three."
            )
        ),
        reason="The models have no more peaks at the modes than elsewhere.",
    )


def _numbers(values: Sequence[float] | NDArray[np.float64]) -> str:
    return " ".join(f"{each:.1f}" for each in values)


def _shares(found: NDArray[np.bool_]) -> str:
    return " ".join(f"{share:.0%}" for share in found.mean(axis=0))


SUBJECTS = (
    Subject(
        "table-2-2",
        "Natural frequencies of models with 27 states, by waveform",
        tuple(Call(waveform_modes, (record,)) for record in RECORDS.values()),
        _table,
    ),
)
