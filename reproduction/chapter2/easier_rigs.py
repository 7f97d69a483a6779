"""Rigs of the study without noise or without friction: what each of them costs a model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from reproduction.chapter2.order_survey import best_error, prepared
from reproduction.framework.findings import SEEDS, Call
from reproduction.framework.rig import run_experiment
from reproduction.framework.study_rig import study_rig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_daq import RigParameters
    from reproduction.framework.findings import Results

NOISELESS_V = (0.0, 0.0, 0.0, 0.0)
_FREE_SEEDS = SEEDS[:5]


def easier_rig(*, noise: bool, friction: bool) -> RigParameters:
    """Return the rig of the study with or without noise, and friction with the gear's play."""
    rig = study_rig()
    if not noise:
        rig = replace(rig, noise_v=NOISELESS_V, hum_v=NOISELESS_V)
    if not friction:
        rig = replace(rig, coulomb_friction_nm=0.0, backlash_deg=0.0)
    return rig


def least_error(name: str, seed: int, noise: bool, friction: bool) -> float:  # noqa: FBT001
    """Return the mean error of the best model, from a rig with or without noise and friction."""
    rig = easier_rig(noise=noise, friction=friction)
    record = prepared(run_experiment(experiment(name), rig, seed))
    return best_error(record, record)


def free_calls(record: str) -> tuple[Call, ...]:
    """Return the least errors of an experiment in the open loop without friction."""
    return tuple(Call(least_error, (record, seed, True, False)) for seed in _FREE_SEEDS)


def by_strength(
    printed: Mapping[str, float], ours: Mapping[str, float], results: Results
) -> dict[str, float]:
    """Compare errors with the thesis's, by magnitude, as they are and without friction.

    Returns
    -------
    dict of str to float
        The least and the largest magnitude, V, and the median ratio of both.
    """
    strengths_v = {record: experiment(record).magnitude_v for record in printed}
    free = {
        record: float(np.median([results[call] for call in free_calls(record)]))
        for record in printed
    }
    found = {}
    for word, choose in (("weak", min), ("strong", max)):
        found[f"{word}_v"] = volts = choose(strengths_v.values())
        some = [record for record in printed if strengths_v[record] == volts]
        for end, errors in (("", ours), ("_free", free)):
            ratios = [errors[record] / printed[record] for record in some]
            found[f"{word}{end}"] = float(np.median(ratios))
    return found
