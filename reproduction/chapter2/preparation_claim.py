"""The steps of preparation that section 2.5 demands, left out one at a time: claim 2-6."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexarm_daq.rigs.rig_parameters import THESIS_NOISE_V
from flexarm_ident.records.preprocess import preprocess
from reproduction.chapter2.order_survey import CUTOFF_HZ, best_error, prepared
from reproduction.framework.evidence import LEVEL, SEEDS, p_text, sign_test, spread
from reproduction.framework.findings import Finding, Judgement, SideBySide, judged
from reproduction.framework.records import simulated_record
from reproduction.framework.subjects import Call, Subject

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.framework.subjects import Results

RECORDS = ("O_dat2", "C_dat3")
"""A record of each kind that the later chapters use."""
OFFSET_V = 0.5
"""Bias that the sensors are given, as the simulated ones have none."""
STEPS = ("biases", "filter", "scaling")
ALL = "all steps"


def step_errors(name: str, seed: int) -> dict[str, float]:
    """Return the mean error with all steps, and with each of them left out.

    Every model is judged on the whole record as it is with all steps.

    Parameters
    ----------
    name
        The experiment.
    seed
        Of its noise.
    """
    raw = simulated_record(name, seed, THESIS_NOISE_V)
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
        ALL: best_error(whole, whole),
        "biases": best_error(biased, whole),
        "filter": best_error(rough, whole),
        "scaling": best_error(whole, whole, scaled=False),
    }


def _claim(results: Results) -> Finding:
    errors = {
        record: [results[Call(step_errors, (record, seed))] for seed in SEEDS] for record in RECORDS
    }
    rows = tuple(
        (
            "none" if step == ALL else step,
            *(spread([each[step] for each in errors[record]]) for record in RECORDS),
        )
        for step in (ALL, *STEPS)
    )
    return Finding(
        preparation_judgement(errors),
        (SideBySide("Mean error, by the step left out", ("left out", *RECORDS), rows),),
        text=(
            (
                f"Where the biases are left in, each sensor has one of {OFFSET_V:g} V, and the "
                "gauges keep their mean. Every model is chosen on the record that it comes from, "
                "and judged on the record with all steps, so that the errors are of one kind. "
                f"{len(SEEDS)} seeds, noise as strong as the thesis's."
            ),
        ),
    )


def preparation_judgement(errors: Mapping[str, Sequence[Mapping[str, float]]]) -> Judgement:
    """Judge by the steps whose omission makes the error larger, by the exact sign test."""
    values = {
        (step, record): sign_test([each[ALL] for each in some], [each[step] for each in some])
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
        evidence=(
            f"That leaving it out makes the model worse: {words}. It holds on both records for "
            f"{', '.join(always) or 'none'}"
            + (f", not on both for {', '.join(seldom)}." if seldom else ".")
        ),
        reason=(
            "A constant bias is largely taken up by the fitted initial state of a slow pole. "
            "The scaling weighs the gauges, which are mostly noise, as much as the position."
        ),
    )


SUBJECTS = (
    Subject(
        "claim-2-6",
        "Biases removed, outputs filtered and scaled: the best identification (2.5, 3)",
        tuple(Call(step_errors, (record, seed)) for record in RECORDS for seed in SEEDS),
        _claim,
    ),
)
