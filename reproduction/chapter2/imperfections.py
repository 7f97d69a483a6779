"""Claims 2-5 to 2-7: noise and nonlinearity, the steps of preparation, the sampling rate."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.experiments.catalogue import catalogue, experiment
from flexarm_ident.records.preprocess import preprocess
from reproduction.chapter2.order_survey import CUTOFF_HZ, best_error, prepared
from reproduction.chapter2.tables import METHOD_TEXT, survey_calls, survey_of
from reproduction.framework.findings import (
    LEVEL,
    SEEDS,
    Call,
    Finding,
    Judgement,
    SideBySide,
    judged,
    p_text,
    prose,
    sign_test,
    spread,
    subject,
)
from reproduction.framework.rig import run_experiment, simulated_record
from reproduction.framework.study_rig import study_rig

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.framework.findings import Results


NOISELESS_V = (0.0, 0.0, 0.0, 0.0)
RIG_RECORD = "O_dat2"
"""A square wave excites the arm in the same way with every seed: only the noise changes."""
EXACT = 0.02
"""The method is effective on a linear system when this little is left of the error: the converters
of the rig round in any case."""


def least_error(name: str, seed: int, noise: bool, friction: bool) -> float:  # noqa: FBT001
    """Return the mean error of the best model, from a rig with or without noise and friction."""
    rig = study_rig()
    if not noise:
        rig = replace(rig, noise_v=NOISELESS_V, hum_v=NOISELESS_V)
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
        evidence=f"The error is {medians['as it is']:.3f}; "
        f"{medians['no friction, no backlash']:.3f} without friction and backlash "
        f"({p_text(linear_p)}), {medians['no noise']:.3f} without noise ({p_text(quiet_p)}), "
        f"{exact:.3f} without either: on a linear system the method is "
        f"{'' if exact <= EXACT else 'not '}as good as exact.",
        reason="Neither noise nor friction makes the error of our rig.",
    )


PREPARED = ("O_dat2", "C_dat3")
"""A record of each kind that the later chapters use."""
OFFSET_V = 0.5
"""Bias that the sensors are given, as the simulated ones have none."""
STEPS = ("biases", "filter", "scaling")
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
    values = {
        (step, record): sign_test([each[ALL_STEPS] for each in some], [each[step] for each in some])
        for step in STEPS
        for record, some in errors.items()
    }
    helps = {step: [record for record in errors if values[step, record] < LEVEL] for step in STEPS}
    always = [step for step, records in helps.items() if len(records) == len(errors)]
    words = "; ".join(
        f"{step}: {', '.join(f'{record} {p_text(values[step, record])}' for record in errors)}"
        for step in STEPS
    )
    seldom = [step for step in STEPS if step not in always]
    return judged(
        agrees=len(always) == len(STEPS),
        same_ranking=all(helps.values()),
        evidence=f"That leaving it out makes the model worse: {words}. It holds on both records "
        f"for {', '.join(always) or 'none'}"
        + (f", not on both for {', '.join(seldom)}." if seldom else "."),
        reason=prose("claim-2-6.reason"),
    )


PAIRS = {
    f"{kind}_dat{low}": f"{kind}_dat{high}"
    for kind, pairs in {
        "O": ((1, 3), (2, 4), (5, 7), (6, 8), (9, 11), (10, 12), (13, 14)),
        "B": ((1, 4), (2, 5), (3, 6), (7, 10), (8, 11), (9, 12)),
    }.items()
    for low, high in pairs
}
"""Experiments at 300 Hz and the same ones at 500 Hz."""


def _rates(results: Results) -> Finding:
    low = {name: survey_of(results, name).mean_dmv for name in PAIRS}
    high = {name: survey_of(results, other).mean_dmv for name, other in PAIRS.items()}
    quiet = {
        name: tuple(results[Call(least_error, (each, 1, False, True))] for each in (name, other))
        for name, other in PAIRS.items()
    }
    rows = tuple(
        (
            f"{name}, {other}",
            f"{catalogue()[name].waveform.replace('_', ' ')} {catalogue()[name].magnitude_v:g} V",
            spread(low[name]),
            spread(high[name]),
            *(f"{each:.3f}" for each in quiet[name]),
        )
        for name, other in PAIRS.items()
    )
    headings = ("records", "excitation", "300 Hz", "500 Hz", "300 Hz, no noise", "500 Hz, no noise")
    low_mean = np.mean(list(low.values()), axis=0).tolist()
    high_mean = np.mean(list(high.values()), axis=0).tolist()
    medians = [(float(np.median(low[name])), float(np.median(high[name]))) for name in PAIRS]
    return Finding(
        rate_judgement(low_mean, high_mean, medians, list(quiet.values())),
        (SideBySide("Mean error of the same experiment at both rates", headings, rows),),
        text=(METHOD_TEXT,),
    )


def rate_judgement(
    low: Sequence[float],
    high: Sequence[float],
    pairs: Sequence[tuple[float, float]],
    quiet: Sequence[tuple[float, float]],
) -> Judgement:
    """Judge the errors at 300 and 500 Hz: means per seed, and those of each pair."""
    p_value = sign_test(low, high)
    won = sum(a < b for a, b in pairs)
    won_quiet = sum(a < b for a, b in quiet)
    return judged(
        agrees=p_value < LEVEL,
        same_ranking=2 * won > len(pairs),
        evidence=f"Mean error over all pairs {np.median(low):.3f} at 300 Hz, {np.median(high):.3f} "
        f"at 500 Hz: that 300 Hz is better {'holds' if p_value < LEVEL else 'does not hold'} "
        f"({p_text(p_value)}). 300 Hz is better in {won} of {len(pairs)} pairs, without noise "
        f"in {won_quiet}.",
        reason=prose("claim-2-7.reason", cutoff_hz=CUTOFF_HZ),
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
    subject(
        "claim-2-7",
        (
            *survey_calls(*PAIRS, *PAIRS.values()),
            *(Call(least_error, (name, 1, False, True)) for name in (*PAIRS, *PAIRS.values())),
        ),
        _rates,
    ),
)
