"""What the drift of the position rests on: full models of chapter 3 from easier rigs."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_daq import RigParameters
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, THESIS_NOISE_V
from flexarm_ident import identify, validate_dmv
from reproduction.chapter2.order_survey import METHOD, fitted_half, prepared
from reproduction.chapter3.reduction_calls import error_text
from reproduction.chapter3.reduction_examples import EXAMPLES
from reproduction.framework.findings import SideBySide
from reproduction.framework.records import run_experiment
from reproduction.framework.sensors import SENSORS
from reproduction.framework.subjects import Call

if TYPE_CHECKING:
    from collections.abc import Mapping

    from reproduction.framework.subjects import Results

AS_IT_IS = "as in the first table"
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
_SEEDS = range(1, 11)


def full_model_errors(code: str, rig: str, seed: int) -> tuple[float, ...]:
    """Return the four errors by data matching of a full model from a rig that is easier to model.

    Parameters
    ----------
    code
        A key of `EXAMPLES`.
    rig
        A key of `RIGS`. Where there is no friction, none is compensated either.
    seed
        Of the record.
    """
    example, changed = EXAMPLES[code], RIGS[rig]
    entry = experiment(example.experiment)
    if entry.law and "coulomb_friction_nm" in changed:
        entry = replace(entry, gains={**entry.gains, "compensation_v": 0.0})
    parameters = RigParameters(payload_kg=entry.payload_kg, noise_v=THESIS_NOISE_V)
    record = prepared(
        run_experiment(entry, replace(parameters, **changed), seed), example.compensation
    )
    found = identify(fitted_half(record), order=example.order, method=METHOD)
    return tuple(validate_dmv(found.model, record).delta.tolist())


def drift_calls(code: str) -> tuple[Call, ...]:
    """Return the computations of `drift_table`."""
    return tuple(Call(full_model_errors, (code, rig, seed)) for rig in RIGS for seed in _SEEDS)


def drift_table(code: str, results: Results) -> SideBySide:
    """List the errors of the full model on easier rigs."""
    rows = []
    for rig in RIGS:
        errors = [results[Call(full_model_errors, (code, rig, seed))] for seed in _SEEDS]
        rows.append((rig, *map(error_text, np.median(errors, axis=0).tolist())))
    return SideBySide(
        f"Errors of the full model by data matching when the rig is easier to model; medians of "
        f"{len(_SEEDS)} records",
        ("rig", *SENSORS),
        tuple(rows),
    )
