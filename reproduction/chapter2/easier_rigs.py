"""Rigs of the study without noise or without friction: what each of them costs a model."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from reproduction.chapter2.order_survey import (
    best_error,
    fitted_half,
    identified,
    matched,
    model_of,
    prepared,
    printed_order,
)
from reproduction.framework.findings import SEEDS, Call
from reproduction.framework.rig import run_experiment
from reproduction.framework.study_rig import study_rig

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_daq import RigParameters
    from reproduction.framework.findings import Results

NOISELESS_V = (0.0, 0.0, 0.0, 0.0)
FREE_SEEDS = SEEDS[:5]
_NOISIER_V = (0.7, 0.45)
"""The next noise of the gauges that `bench calibration` tries."""


def easier_rig(*, noise: bool, friction: bool, payload_kg: float = 0.0) -> RigParameters:
    """Return the rig of the study with or without noise, and friction with the gear's play."""
    rig = study_rig(payload_kg)
    if not noise:
        rig = replace(rig, noise_v=NOISELESS_V, hum_v=NOISELESS_V)
    if not friction:
        rig = replace(rig, coulomb_friction_nm=0.0, backlash_deg=0.0)
    return rig


def least_error(name: str, seed: int, noise: bool, friction: bool) -> float:  # noqa: FBT001
    """Return the mean error of the best model, from a rig with or without noise and friction."""
    entry = experiment(name)
    rig = easier_rig(noise=noise, friction=friction, payload_kg=entry.payload_kg)
    record = prepared(run_experiment(entry, rig, seed))
    return best_error(record, record)


def free_calls(record: str, seeds: Sequence[int] = FREE_SEEDS) -> tuple[Call, ...]:
    """Return the least errors of an experiment without friction."""
    return tuple(Call(least_error, (record, seed, True, False)) for seed in seeds)


def other_errors(name: str, seed: int) -> dict[str, NDArray[np.float64]]:
    """Return the errors of the outputs by data matching, at the printed order, on other rigs."""
    entry = experiment(name)
    rig = study_rig(entry.payload_kg)
    position_v, *_, speed_v = rig.noise_v
    easier = partial(easier_rig, payload_kg=entry.payload_kg)
    noisier_v = (position_v, *_NOISIER_V, speed_v)
    rigs = {
        "without noise": easier(noise=False, friction=True),
        "without friction and gear play": easier(noise=True, friction=False),
        "without any of these": easier(noise=False, friction=False),
        "with noise of {:g} and {:g} V at the gauges".format(*_NOISIER_V): replace(
            rig, noise_v=noisier_v
        ),
    }
    errors = {}
    for words, other in rigs.items():
        whole = prepared(run_experiment(entry, other, seed))
        model, _ = model_of(identified(fitted_half(whole)), printed_order(name))
        errors[words] = matched(model, whole).delta
    return errors


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
