"""Position errors of full models, and what makes them: the same orders from easier rigs."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V
from reproduction.chapter2.order_survey import fitted_half, identified, matched, model_of, prepared
from reproduction.chapter3.examples import EXAMPLES
from reproduction.chapter3.trial import error_text
from reproduction.framework.findings import SENSORS, Call, SideBySide, prose
from reproduction.framework.rig import run_experiment
from reproduction.framework.study_rig import study_rig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from reproduction.framework.findings import Results


DRIFTING = frozenset({"3-2", "3-3", "3-4"})
"""Tables beside which the errors of the full model on easier rigs stand."""
AS_IT_IS = "as it is"
_FREE = {"coulomb_friction_nm": 0.0}
RIGS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        AS_IT_IS: {},
        "little noise": {"noise_v": LOW_NOISE_V},
        "no friction": _FREE,
        "no friction, no gear play, little noise": {
            **_FREE,
            "backlash_deg": 0.0,
            "noise_v": LOW_NOISE_V,
        },
    }
)
"""Rigs by what makes them easier to model."""
_DRIFT_SEEDS = range(1, 11)


def full_model_errors(code: str, rig: str, seed: int) -> tuple[float, ...]:
    """Return the four errors by data matching of a full model from one of the easier `RIGS`."""
    example, changed = EXAMPLES[code], RIGS[rig]
    entry = experiment(example.experiment)
    if entry.law and "coulomb_friction_nm" in changed:
        entry = replace(entry, gains={**entry.gains, "compensation_v": 0.0})
    parameters = study_rig(entry.payload_kg)
    record = prepared(
        run_experiment(entry, replace(parameters, **changed), seed), example.compensation
    )
    model, _ = model_of(identified(fitted_half(record)), example.order)
    return tuple(matched(model, record).delta.tolist())


def drift_calls(code: str) -> tuple[Call, ...]:
    """Return the computations of `drift_table`."""
    return tuple(
        Call(full_model_errors, (code, rig, seed)) for rig in RIGS for seed in _DRIFT_SEEDS
    )


def median_errors(code: str, rig: str, results: Results) -> list[float]:
    """Return the errors of the printed order, clamped where it is unstable, from one of `RIGS`."""
    found = [results[Call(full_model_errors, (code, rig, seed))] for seed in _DRIFT_SEEDS]
    middle: list[float] = np.median(found, axis=0).tolist()
    return middle


def drift_table(code: str, results: Results) -> SideBySide:
    """List the errors of the full model on easier rigs."""
    rows = [(rig, *map(error_text, median_errors(code, rig, results))) for rig in RIGS]
    return SideBySide(
        prose("table-3-xb.drift_title", seeds=len(_DRIFT_SEEDS)),
        ("rig", *SENSORS),
        tuple(rows),
    )
