"""What the thesis claims of PDPC: compensation, one set of gains, the condition (section 4.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reproduction.chapter4.pdpc_runs import (
    CASES,
    GAUGE_TEXT,
    SETTLING_TEXT,
    TRIALS,
    ZERO_ERROR_V,
    calm_judgement,
    payload_judgement,
    tracking_table,
    trials_of,
    vibration_table,
)
from reproduction.framework.evidence import LEVEL, p_text, sign_test, spread
from reproduction.framework.findings import Finding, Judgement, SideBySide, judged
from reproduction.framework.subjects import Subject

if TYPE_CHECKING:
    from reproduction.framework.subjects import Results

WITHOUT_V = 0.1


def _compensation(results: Results) -> Finding:
    trials = trials_of(results)
    rows, p_error = [], {}
    for payload_kg, setpoint_v in CASES:
        with_it, without = (
            [abs(each[name, payload_kg].mean_error_v) for each in trials]
            for name in ("pdpc", "pdp")
        )
        p_error[payload_kg] = sign_test(with_it, without)
        rows.append(
            (
                f"{1e3 * payload_kg:.0f} g, {setpoint_v:g} V",
                spread(with_it),
                spread(without),
                p_text(p_error[payload_kg]),
            )
        )
    error_v = max(abs(each["pdpc", kg].mean_error_v) for each in trials for kg, _ in CASES)
    least_v = min(abs(each["pdp", kg].mean_error_v) for each in trials for kg, _ in CASES)
    heading = ("step", "with, V", "without, V", "with is closer")
    return Finding(
        tracking_judgement(error_v, least_v, max(p_error.values())),
        (
            SideBySide(
                "Tracking error with and without compensation, 20 seeds", heading, tuple(rows)
            ),
        ),
        text=("That it should be conditional is claim-4-6.",),
    )


def tracking_judgement(with_v: float, without_v: float, p_value: float) -> Judgement:
    """Judge whether it takes the compensation to reach the set-point."""
    return judged(
        agrees=with_v <= ZERO_ERROR_V and without_v >= WITHOUT_V and p_value < LEVEL,
        same_ranking=p_value < LEVEL,
        evidence=(
            f"With compensation the error is at most {with_v:.3f} V, without it at least "
            f"{without_v:.2f} V ({p_text(p_value)} at every payload)."
        ),
        reason="The compensation does not decide the error.",
    )


def _robust(results: Results) -> Finding:
    table, steps = tracking_table(trials_of(results))
    return Finding(payload_judgement(steps), (table,), text=(SETTLING_TEXT,))


def _conditional(results: Results) -> Finding:
    vibration, calmer = vibration_table(trials_of(results))
    return Finding(calm_judgement(calmer), (vibration,), text=(GAUGE_TEXT,))


SUBJECTS = (
    Subject(
        "claim-4-3",
        "Friction compensation is needed for zero tracking error",
        TRIALS,
        _compensation,
    ),
    Subject(
        "claim-4-5",
        "One set of PDPC gains does for 0 to 400 g (4.3)",
        TRIALS,
        _robust,
    ),
    Subject(
        "claim-4-6",
        "The compensation should be conditional: gear hitting makes the arm vibrate (4.5, 3)",
        TRIALS,
        _conditional,
    ),
)
