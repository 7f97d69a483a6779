"""Appendix B: the models that the thesis prints, beside those identified from the simulated rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_control.models.nominal_models import nominal_model
from flexarm_core.channels import POSITION_V_PER_RAD, SPEED_V_S_PER_RAD
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.modes import frequency_and_damping
from reproduction.chapter2.order_survey import updated_model
from reproduction.framework.findings import (
    SEEDS,
    SENSORS,
    Call,
    Finding,
    Plot,
    SideBySide,
    Subject,
    prose,
    spread,
    thesis_table,
)
from reproduction.framework.plots import range_plot
from reproduction.framework.study_rig import study_rig
from reproduction.framework.verdicts import Beside, judged, not_comparable

if TYPE_CHECKING:
    import control
    from numpy.typing import NDArray

    from reproduction.framework.findings import Results

FREQUENCIES_HZ = np.geomspace(0.3, 50.0, 120)
BANDS_HZ = ((0.3, 1.0), (1.0, 6.0), (6.0, 30.0), (30.0, 50.0))
GAP_DB = 3.0
"""Gains agree within this, a factor of 1.4: gauge errors of about 0.4 (Table 2-4) leave no more."""
NEAR = 0.1
"""A mode agrees within this: as far is the thesis's analytic 25 Hz from its identified 22.8 Hz."""
_VIBRATES = 0.3
_FLEXIBLE_HZ = 4.0


@dataclass(frozen=True)
class IdentifiedModel:
    """Response of a reduced model at `FREQUENCIES_HZ`, and Hz and damping ratio of each pair."""

    response: NDArray[np.complex128]
    modes: tuple[tuple[float, float], ...]


def identified(
    payload_kg: float, record: str, full_order: int, order: int
) -> tuple[IdentifiedModel, ...]:
    """Identify and reduce as the thesis did for its nominal model, once per seed."""
    return tuple(identified_once(payload_kg, record, full_order, order, seed) for seed in SEEDS)


def identified_once(
    payload_kg: float, record: str, full_order: int, order: int, seed: int
) -> IdentifiedModel:
    """Do so with one seed; see `identified`."""
    known_hz = natural_frequencies_hz(study_rig(payload_kg)).tolist()
    reduced = updated_model(record, seed, (full_order, order), known_hz)
    return described(reduced)


def described(model: control.StateSpace) -> IdentifiedModel:
    """Return the response and the modes of a model."""
    pairs = [complex(each) for each in np.linalg.eigvals(model.A) if each.imag > 0.0]
    return IdentifiedModel(
        frequency_response(model, FREQUENCIES_HZ)[:, :, 0],
        tuple(sorted(frequency_and_damping(each, model.dt) for each in pairs)),
    )


def compare(payload_kg: float, found: tuple[IdentifiedModel, ...]) -> Finding:
    """Set a printed model beside ours."""
    printed = described(nominal_model(payload_kg))
    beam_hz = natural_frequencies_hz(study_rig(payload_kg))
    mode_rows, missing = _mode_rows(printed, found, beam_hz)
    gaps_db = gains_off_db(printed, found)
    rigid_db = np.median(gaps_db[:, 0], axis=0)
    contradiction = contradiction_db(printed)
    heavier = _heavier_and_faster(printed)
    reason = _reason(missing, beam_hz, contradiction, np.median(gaps_db, axis=0))
    return Finding(
        not_comparable(f"{heavier} {reason}")
        if heavier
        else judged(figures=_figures(printed, found, rigid_db), reason=reason),
        tables=(
            SideBySide(
                f"Modes: the printed matrix, ours (median of {len(SEEDS)} seeds and range), the "
                "beam alone",
                ("printed, Hz", "damping", "ours, Hz", "range", "damping", "beam, Hz"),
                mode_rows,
            ),
            SideBySide(
                f"Our gain over the printed one, dB: median of {len(SEEDS)} seeds, and range",
                ("band, Hz", *SENSORS, "printed y4 over the derivative of its y1"),
                tuple(
                    (
                        f"{low:g} to {high:g}",
                        *(
                            spread(gaps_db[:, i, channel], "+.1f")
                            for channel in range(len(SENSORS))
                        ),
                        f"{contradiction[i]:.1f}",
                    )
                    for i, (low, high) in enumerate(BANDS_HZ)
                ),
            ),
        ),
        plots=tuple(
            Plot(
                f"{channel}: printed and ours, {len(SEEDS)} seeds",
                range_plot(
                    FREQUENCIES_HZ,
                    np.abs([each.response[:, i] for each in found]),
                    channel,
                    np.abs(printed.response[:, i]),
                ),
            )
            for i, channel in enumerate(SENSORS)
        ),
        text=(_text(payload_kg),),
    )


def contradiction_db(printed: IdentifiedModel) -> NDArray[np.float64]:
    """Return how far speed and position of a model contradict each other, per band.

    Potentiometer and tachometer sit on one shaft: y4 is the derivative of y1 times a constant. The
    root mean square over the band, in dB.
    """
    speed = 2.0 * np.pi * FREQUENCIES_HZ * np.abs(printed.response[:, 0])
    ratio_db = _decibels(np.abs(printed.response[:, 3]) / speed)
    ratio_db -= _decibels(SPEED_V_S_PER_RAD / POSITION_V_PER_RAD)
    return np.array([np.sqrt(np.mean(ratio_db[inside] ** 2)) for inside in _inside()])


def _text(payload_kg: float) -> str:
    values = thesis_table("appendix_b")["models"][payload_kg]
    return prose(
        "appendix-b-model.text",
        record=values["record"],
        full_order=values["full_order"],
        order=values["order"],
    )


def _reason(
    missing: list[float],
    beam_hz: NDArray[np.float64],
    contradiction: NDArray[np.float64],
    gaps_db: NDArray[np.float64],
) -> str:
    parts = []
    for frequency_hz in missing:
        beam = beam_hz[np.argmin(np.abs(np.log(beam_hz / frequency_hz)))]
        words = f"the beam has {beam:.1f} Hz where {frequency_hz:.1f} Hz are printed"
        parts.append(f"{words[0].upper()}{words[1:]}.")
    parts.append(
        prose(
            "appendix-b-model.reason",
            band_slow=_band(0),
            band_low=_band(1),
            band_high=_band(2),
            low_db=contradiction[1],
            high_db=contradiction[2],
            base_low=gaps_db[0, 1],
            middle_low=gaps_db[0, 2],
            base_high=gaps_db[2, 1],
            middle_high=gaps_db[2, 2],
        )
    )
    return " ".join(parts)


def _band(number: int) -> str:
    return "{:g} to {:g}".format(*BANDS_HZ[number])


def _figures(
    printed: IdentifiedModel,
    found: tuple[IdentifiedModel, ...],
    rigid_db: NDArray[np.float64],
) -> tuple[Beside, Beside]:
    """Return the flexible frequencies, and the gains where the motion is rigid, with ours."""
    theirs_hz = [mode[0] for mode in _flexible(printed)]
    ours_hz = [float(np.median([_nearest(each, hz)[0] for each in found])) for hz in theirs_hz]
    gains_db = np.median(_decibels(np.abs(printed.response[_inside()[0]])), axis=0)
    theirs, ours = (
        tuple((10.0 ** (each / 20.0)).tolist()) for each in (gains_db, gains_db + rigid_db)
    )
    return (
        Beside("flexible frequencies", tuple(theirs_hz), tuple(ours_hz), 1.0 + NEAR),
        Beside(f"gains from {_band(0)} Hz", theirs, ours, 10.0 ** (GAP_DB / 20.0)),
    )


def _heavier_and_faster(printed: IdentifiedModel) -> str:
    """Say which modes are faster than those without payload: a mass can only slow them down."""
    bare = np.array([mode[0] for mode in _flexible(described(nominal_model(0.0)))])
    words = []
    for frequency_hz, _ in _flexible(printed):
        without = bare[np.argmin(np.abs(np.log(bare / frequency_hz)))]
        if frequency_hz > without:
            words.append(f"{frequency_hz:.1f} Hz where there are {without:.1f} Hz without payload")
    if not words:
        return ""
    return f"Printed are {', and '.join(words)}: a mass can only lower a frequency."


def _mode_rows(
    printed: IdentifiedModel, found: tuple[IdentifiedModel, ...], beam_hz: NDArray[np.float64]
) -> tuple[tuple[tuple[str, ...], ...], list[float]]:
    """Return the rows of the table, and the printed flexible modes that ours have not."""
    rows, missing = [], []
    for frequency_hz, damping in printed.modes:
        flexible = (frequency_hz, damping) in _flexible(printed)
        beam = beam_hz[np.argmin(np.abs(np.log(beam_hz / frequency_hz)))]
        nearest = [_nearest(each, frequency_hz) for each in found]
        ours_hz, ours_damping = np.array(nearest).T
        is_near = abs(float(np.median(ours_hz)) / frequency_hz - 1.0) <= NEAR
        if flexible and not is_near:
            missing.append(frequency_hz)
        rows.append(
            (
                f"{frequency_hz:.2f}",
                f"{damping:.3f}",
                f"{np.median(ours_hz):.2f}",
                f"{ours_hz.min():.2f} to {ours_hz.max():.2f}",
                f"{np.median(ours_damping):.3f}",
                f"{beam:.2f}" if flexible else "rigid motion",
            )
        )
    return tuple(rows), missing


def _flexible(model: IdentifiedModel) -> list[tuple[float, float]]:
    return [
        (frequency_hz, damping)
        for frequency_hz, damping in model.modes
        if frequency_hz > _FLEXIBLE_HZ and damping < _VIBRATES
    ]


def _nearest(model: IdentifiedModel, frequency_hz: float) -> tuple[float, float]:
    return min(model.modes, key=lambda mode: abs(np.log(mode[0] / frequency_hz)))


def gains_off_db(
    printed: IdentifiedModel, found: tuple[IdentifiedModel, ...]
) -> NDArray[np.float64]:
    """Return the median gap per seed, band and channel."""
    ratios = np.array([each.response / printed.response for each in found])
    ratios_db = _decibels(np.abs(ratios))
    return np.stack([np.median(ratios_db[:, inside], axis=1) for inside in _inside()], axis=1)


def _inside() -> list[NDArray[np.bool_]]:
    return [(low <= FREQUENCIES_HZ) & (high >= FREQUENCIES_HZ) for low, high in BANDS_HZ]


def _decibels(gain: Any) -> Any:  # noqa: ANN401 - an array or one number
    return 20.0 * np.log10(gain)


def _subject(number: int, payload_kg: float) -> Subject:
    values = thesis_table("appendix_b")["models"][payload_kg]
    call = Call(identified, (payload_kg, values["record"], values["full_order"], values["order"]))

    def build(results: Results) -> Finding:
        return compare(payload_kg, results[call])

    grams = 1e3 * payload_kg
    return Subject(f"appendix-b-{number}", f"The nominal model with {grams:.0f} g", (call,), build)


SUBJECTS: tuple[Subject, ...] = tuple(
    _subject(number, payload_kg) for number, payload_kg in enumerate((0.0, 0.2, 0.4), start=1)
)
