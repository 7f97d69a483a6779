"""Claims 2-5 and 2-6: noise and nonlinearity, and the steps of preparation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.records.preprocess import preprocess
from reproduction.chapter2.easier_rigs import least_error
from reproduction.chapter2.order_survey import CUTOFF_HZ, best_error, prepared
from reproduction.chapter2.tables import METHOD_TEXT, survey_calls, survey_of
from reproduction.framework.findings import SEEDS, Call, Finding, SideBySide, prose, spread, subject
from reproduction.framework.rig import simulated_record
from reproduction.framework.verdicts import Judgement, all_of, exactly, judged, less

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.framework.findings import Results


RIG_RECORD = "O_dat2"
"""A square wave excites the arm in the same way with every seed: only the noise changes."""
EXACT = 0.02
"""The method is effective on a linear system when this little is left of the error: the converters
of the rig round in any case."""


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
    exact = errors["neither"][0]
    medians = ", ".join(f"{np.median(each):.3f} ({name})" for name, each in errors.items())
    return judged(
        statements=(
            less("noise costs accuracy", list(errors["no noise"]) * len(real), real),
            less("friction and backlash do", errors["no friction, no backlash"], real),
            exactly("on a linear system the method is effective", holds=exact <= EXACT),
        ),
        evidence=f"Errors: {medians}.",
        reason="Neither noise nor friction makes the error of our rig.",
    )


PREPARED = ("O_dat2", "C_dat3")
"""A record of each kind that the later chapters use."""
OFFSET_V = 0.5
"""Bias that the sensors are given, as the simulated ones have none."""
STEPS = {
    "biases": "leaving the biases in",
    "filter": "leaving the filter out",
    "scaling": "leaving the scaling out",
}
"""Steps of the preparation, and what it means to do without each."""
ALL_STEPS = "all steps"


def step_errors(name: str, seed: int) -> dict[str, float]:
    """Return the mean error with all steps and with each left out, on the prepared record."""
    raw = simulated_record(name, seed)
    whole = prepared(raw)
    biased = preprocess(
        replace(raw, y=raw.y + OFFSET_V),
        bias="none",
        zero_mean=(),
        cutoff_hz=CUTOFF_HZ,
        filter_input=False,
    )
    rough = preprocess(raw, bias="first")
    return {
        ALL_STEPS: best_error(whole, whole),
        "biases": best_error(biased, whole),
        "filter": best_error(rough, whole),
        "scaling": best_error(whole, whole, scaled=False),
    }


def _preparation(results: Results) -> Finding:
    errors = {
        record: [results[Call(step_errors, (record, seed))] for seed in SEEDS]
        for record in PREPARED
    }
    rows = tuple(
        (
            "none" if step == ALL_STEPS else step,
            *(spread([each[step] for each in errors[record]]) for record in PREPARED),
        )
        for step in (ALL_STEPS, *STEPS)
    )
    return Finding(
        preparation_judgement(errors),
        (SideBySide("Mean error, by the step left out", ("left out", *PREPARED), rows),),
        text=(prose("claim-2-6.text", offset_v=OFFSET_V, seeds=len(SEEDS)),),
    )


def preparation_judgement(errors: Mapping[str, Sequence[Mapping[str, float]]]) -> Judgement:
    """Judge by the steps whose omission makes the error larger, by the exact sign test."""
    return judged(
        statements=[
            all_of(
                f"{left_out} makes the model worse",
                [
                    less(record, [each[ALL_STEPS] for each in some], [each[step] for each in some])
                    for record, some in errors.items()
                ],
            )
            for step, left_out in STEPS.items()
        ],
        evidence=f"Judged on {' and '.join(errors)}, and it has to hold on both.",
        reason=prose("claim-2-6.reason"),
    )


SUBJECTS = (
    subject(
        "claim-2-5",
        (
            *survey_calls(RIG_RECORD),
            *(Call(least_error, (RIG_RECORD, seed, True, False)) for seed in SEEDS),
            *(Call(least_error, (RIG_RECORD, SEEDS[0], False, some)) for some in (True, False)),
        ),
        _imperfections,
    ),
    subject(
        "claim-2-6",
        tuple(Call(step_errors, (record, seed)) for record in PREPARED for seed in SEEDS),
        _preparation,
    ),
)
