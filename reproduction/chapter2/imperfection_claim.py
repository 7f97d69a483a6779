"""Noise and nonlinearity cost accuracy: claim 2-5."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq import RigParameters
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.rig_parameters import THESIS_NOISE_V
from reproduction.chapter2.order_survey import best_error, prepared
from reproduction.chapter2.survey_tables import METHOD_TEXT, survey_calls, survey_of
from reproduction.framework.evidence import LEVEL, SEEDS, p_text, sign_test, spread
from reproduction.framework.findings import Finding, Judgement, SideBySide, judged
from reproduction.framework.records import run_experiment
from reproduction.framework.subjects import Call, Subject

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.framework.subjects import Results

NOISELESS_V = (0.0, 0.0, 0.0, 0.0)
RIG_RECORD = "O_dat2"
"""A square wave excites the arm in the same way with every seed: only the noise changes."""
EXACT = 0.02
"""The method is effective on a linear system when this little is left of the error: the converters
of the rig round in any case."""


def least_error(name: str, seed: int, noise: bool, friction: bool) -> float:  # noqa: FBT001
    """Return the mean error of the best model, from a rig with or without its imperfections.

    Parameters
    ----------
    name
        The experiment.
    seed
        Of noise and excitation.
    noise
        Whether the sensors have the thesis's noise, or none.
    friction
        Whether the rig has Coulomb friction and backlash.
    """
    rig = RigParameters(noise_v=THESIS_NOISE_V if noise else NOISELESS_V)
    if not friction:
        rig = replace(rig, coulomb_friction_nm=0.0, backlash_deg=0.0)
    record = prepared(run_experiment(experiment(name), rig, seed))
    return best_error(record, record)


def _rig_errors(results: Results) -> dict[str, list[float]]:
    def of(*, noise: bool, friction: bool) -> list[float]:
        seeds = SEEDS if noise else SEEDS[:1]
        return [results[Call(least_error, (RIG_RECORD, seed, noise, friction))] for seed in seeds]

    return {
        "as it is": survey_of(results, RIG_RECORD).mean_dmv.tolist(),
        "no friction, no backlash": of(noise=True, friction=False),
        "no noise": of(noise=False, friction=True),
        "neither": of(noise=False, friction=False),
    }


def _imperfections(results: Results) -> Finding:
    errors = _rig_errors(results)
    rows = tuple((name, spread(each)) for name, each in errors.items())
    return Finding(
        imperfection_judgement(errors),
        (SideBySide(f"Mean error, {RIG_RECORD}", ("rig", "ours"), rows),),
        text=(
            METHOD_TEXT,
            "Here the rig itself is changed. Without noise every seed gives the same record.",
        ),
    )


def imperfection_judgement(errors: Mapping[str, Sequence[float]]) -> Judgement:
    """Judge whether noise and nonlinearity each cost accuracy, and nothing else does."""
    real = errors["as it is"]
    linear_p = sign_test(errors["no friction, no backlash"], real)
    quiet_p = sign_test(list(errors["no noise"]) * len(real), real)
    exact = errors["neither"][0]
    medians = {name: float(np.median(each)) for name, each in errors.items()}
    return judged(
        agrees=linear_p < LEVEL and quiet_p < LEVEL and exact <= EXACT,
        same_ranking=linear_p < LEVEL or quiet_p < LEVEL,
        evidence=(
            f"The error is {medians['as it is']:.3f}; {medians['no friction, no backlash']:.3f} "
            f"without friction and backlash ({p_text(linear_p)}), {medians['no noise']:.3f} "
            f"without noise ({p_text(quiet_p)}), {exact:.3f} without either: on a linear system "
            f"the method is {'' if exact <= EXACT else 'not '}as good as exact."
        ),
        reason="Neither noise nor friction makes the error of our rig.",
    )


SUBJECTS = (
    Subject(
        "claim-2-5",
        "Noise and nonlinearity reduce the accuracy of the model (2.5, 1 and 2)",
        (
            *survey_calls(RIG_RECORD),
            *(Call(least_error, (RIG_RECORD, seed, True, False)) for seed in SEEDS),
            *(Call(least_error, (RIG_RECORD, SEEDS[0], False, some)) for some in (True, False)),
        ),
        _imperfections,
    ),
)
