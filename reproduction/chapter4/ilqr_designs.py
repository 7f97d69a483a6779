"""Choice 4-1: the ILQR law with the thesis's weights, and variants of rig and law that hunt.

The thesis weighs the states of its own model, an ORSE realisation: so ours is brought into that
form by (3-10) before its weights are used.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.ilqr import Ilqr, IlqrDesign, IlqrWeights, design_ilqr
from flexarm_control.models.nominal_models import identified_model
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident.reduction.balanced import thesis_realisation
from reproduction.chapter2.order_survey import fitted_half, thesis_record, updated_model
from reproduction.framework.findings import (
    OFTEN,
    SEEDS,
    Call,
    Finding,
    SideBySide,
    prose,
    spread,
    subject,
    thesis_table,
)
from reproduction.framework.realisations import rounded_model
from reproduction.framework.rig import step_to
from reproduction.framework.study_rig import calm_rig, choices
from reproduction.framework.verdicts import Judgement, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from reproduction.framework.findings import Results

PAYLOAD_KG = 0.3
HUNTS = 0.2
"""Swing, peak to peak, from which the arm counts as hunting."""
OURS, PRINTED, INTEGRAL = "ours", "as printed", "ours, K_I as printed"
_RECORD = "C_dat11"
# Ac11r_8 of Table 3-6: section 4.4 names the payload and the order.
_ORDERS, _FLEXIBLE_MODES = (26, 8), 2
# As the thesis prints its gains.
_GAIN_DIGITS = 4


@cache
def ilqr_design(name: str) -> IlqrDesign:
    """Return one of the designs by its name."""
    if name == PRINTED:
        known_hz = natural_frequencies_hz(calm_rig(PAYLOAD_KG))[:_FLEXIBLE_MODES].tolist()
        model = updated_model(_RECORD, SEEDS[0], _ORDERS, known_hz)
        half = fitted_half(thesis_record(_RECORD, SEEDS[0]))
        return printed_design(thesis_realisation(model, half, block_rows=choices().block_rows))
    design = design_ilqr(identified_model())
    return design if name == OURS else replace(design, ki=thesis_table("section_4_4")["ki"])


def printed_design(realised: control.StateSpace) -> IlqrDesign:
    """Design by the weights of section 4.4, which are of the states of an ORSE realisation."""
    printed = thesis_table("section_4_4")
    weights = IlqrWeights(
        position=0.0,
        strain=0.0,
        speed=0.0,
        states=tuple(printed["q"]),
        effort=printed["r"],
        ki=printed["ki"],
        observer_speed=0.0,
    )
    design = design_ilqr(rounded_model(realised), weights)
    return replace(design, kp=round(design.kp, _GAIN_DIGITS))


LAWS = (OURS, INTEGRAL, PRINTED)
ARMS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "as it is": {},
        "a quarter more friction": {"coulomb_friction_nm": 1.25},
        "three times the gear play": {"backlash_deg": 3.0},
        "break-away a fifth higher": {"breakaway_ratio": 1.2},
        "break-away two fifths higher": {"breakaway_ratio": 1.4},
    }
)
"""Rigs by what is changed, and the factor of it."""
SETPOINT_V = 5.0
LENGTH_S, LATE_S = 40.0, 30.0
_SEEDS = SEEDS[:5]


def late_swing_v(law: str, arm: str, seed: int) -> float:
    """Return how far the arm still swings, peak to peak, from 30 to 40 s after a step of 5 V."""
    rig = calm_rig(PAYLOAD_KG)
    changed = {name: factor * getattr(rig, name) for name, factor in ARMS[arm].items()}
    run = step_to(
        Ilqr(ilqr_design(law)),
        SETPOINT_V,
        arm=replace(rig, **changed),
        seed=seed,
        length_s=LENGTH_S,
    )
    return float(np.ptp(run.true_y[run.time_s >= LATE_S, 0]))


VARIANTS = {
    (arm, law): tuple(Call(late_swing_v, (law, arm, seed)) for seed in _SEEDS)
    for arm in ARMS
    for law in LAWS
}
VARIANT_CALLS = tuple(call for calls in VARIANTS.values() for call in calls)


def hunting_variants(results: Results) -> list[tuple[str, str]]:
    """Return rig and law of the variants that still hunt after 30 s, in most of the seeds."""
    return [
        variant
        for variant, calls in VARIANTS.items()
        if np.mean([results[call] >= HUNTS for call in calls]) > OFTEN
    ]


def _build(results: Results) -> Finding:
    rows = tuple(
        (arm, *(spread([results[call] for call in VARIANTS[arm, law]], ".2f") for law in LAWS))
        for arm in ARMS
    )
    title = f"Position from {LATE_S:g} to {LENGTH_S:g} s after a step of {SETPOINT_V:g} V, V"
    return Finding(
        variants_judgement(hunting_variants(results)),
        (SideBySide(f"{title}, peak to peak, {len(_SEEDS)} seeds", ("rig", *LAWS), rows),),
        text=(prose("choice-4-1.text", hunts=HUNTS, late_s=LATE_S),),
    )


def variants_judgement(hunting: Sequence[tuple[str, str]]) -> Judgement:
    """Say in which variants the arm goes on hunting."""
    listed = "; ".join(f"{arm} ({law})" for arm, law in hunting) or "none"
    return Judgement(
        Verdict.OURS,
        f"Of {len(VARIANTS)} variants of rig and law {len(hunting)} still hunt after "
        f"{LATE_S:g} s: {listed}.",
    )


SUBJECTS = (subject("choice-4-1", VARIANT_CALLS, _build),)
