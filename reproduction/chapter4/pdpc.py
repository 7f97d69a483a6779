"""Figures 4-10 to 4-12, claims 4-3, 4-5 and 4-6: the PDPC law on the rig (section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.laws.registry import build_law
from flexarm_control.references import build_reference
from reproduction.framework.findings import (
    SEEDS,
    Call,
    Finding,
    Plot,
    SideBySide,
    columns,
    prose,
    spread,
    subject,
)
from reproduction.framework.plots import time_plot
from reproduction.framework.rig import AT_REST_S, RATE_HZ, StepTrial, run_law, step_to, step_trial
from reproduction.framework.study_rig import calm_rig
from reproduction.framework.verdicts import (
    Judgement,
    Statement,
    always,
    elsewhere,
    judged,
    less,
    p_text,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_control.simulation import LoopRun
    from reproduction.framework.findings import Results

SHOWN = 1
CASES = ((0.0, 1.0), (0.2, 3.0), (0.4, 5.0))
"""Payloads, kg, and set-points, V, of Figure 4-11 (R_dat6 to R_dat8)."""
Trials: TypeAlias = "dict[tuple[str, float], StepTrial]"
"""By law and payload, kg."""
LAWS = ("pdpc", "pdpc_unconditional", "pdp")
ZERO_ERROR_V = 0.05
"""The law's own threshold: closer than this it does not compensate, so closer it need not get."""
DIES_OUT = 0.10
"""Share of its first swing to which a vibration falls when it dies out."""
_BASE, _MIDDLE = 1, 2
_WORST_KG, _WORST_V, _PERIOD_S, _PERIODS = 0.4, 5.0, 20.0, 2
GAUGE_TEXT = prose("chapter-4.gauge", noise_v=calm_rig().noise_v[1])
SETTLING_TEXT = prose("chapter-4.settling")


@dataclass(frozen=True)
class SquareRun:
    """The square wave of Figure 4-12 and the vibration late in each half-period, V."""

    run: LoopRun
    moving_v: float
    resting_v: float


def pdpc_trials(seed: int) -> Trials:
    """Step every payload under every law; by law and payload."""
    return {
        (name, payload_kg): step_trial(pdpc_step(name, payload_kg, setpoint_v, seed))
        for name in LAWS
        for payload_kg, setpoint_v in CASES
    }


def pdpc_step(name: str, payload_kg: float, setpoint_v: float, seed: int) -> LoopRun:
    """Step one payload under one law."""
    # The thesis's gains and thresholds are the defaults of the class.
    law = Pdpc() if name == "pdpc" else build_law(name)
    return step_to(law, setpoint_v, arm=calm_rig(payload_kg), seed=seed)


def pdpc_square(seed: int) -> SquareRun:
    """Follow the square wave of Figure 4-12 with 400 g."""
    reference = build_reference("square", {"amplitude_v": _WORST_V, "period_s": _PERIOD_S})
    samples = round(_PERIODS * _PERIOD_S * RATE_HZ)
    reference_v = np.array([reference(k / RATE_HZ) for k in range(samples)])
    arm = calm_rig(_WORST_KG)
    run = run_law(Pdpc(), reference_v, arm=arm, seed=seed)
    since_s = run.time_s % (0.5 * _PERIOD_S)
    gauge_v = run.true_y[:, _BASE]
    moving, resting = since_s < 0.1 * _PERIOD_S, since_s >= 0.4 * _PERIOD_S
    return SquareRun(run, float(np.ptp(gauge_v[moving])), float(np.ptp(gauge_v[resting])))


TRIALS = tuple(Call(pdpc_trials, (seed,)) for seed in SEEDS)


def trials_of(results: Results) -> list[Trials]:
    """Return the trials of every seed."""
    return [results[call] for call in TRIALS]


def _strain(results: Results) -> Finding:
    trials = trials_of(results)
    plots = []
    for name, words in (("pdpc", "conditional"), ("pdpc_unconditional", "unconditional")):
        run = results[Call(pdpc_step, (name, 0.0, 1.0, SHOWN))]
        for gauge, index in (("base", _BASE), ("middle", _MIDDLE)):
            caption = f"{gauge} gauge, {words} compensation, 0 g, 1 V"
            plots.append(_plot(caption, run.time_s, _signals(run, index), f"{gauge} strain"))
    vibration, _ = vibration_table(trials)
    judgement = elsewhere("claim-4-6", "The vibration with and without the condition is judged at")
    return Finding(judgement, (vibration,), plots, (GAUGE_TEXT,))


def _signals(run: LoopRun, sensor: int) -> dict[str, NDArray[np.float64]]:
    return {"measured": run.y[:, sensor], "without noise": run.true_y[:, sensor]}


def _plot(
    caption: str, time_s: NDArray[np.float64], signals: dict[str, NDArray[np.float64]], words: str
) -> Plot:
    return Plot(caption, time_plot(time_s, signals, f"{words}, V", caption))


def vibration_table(trials: Sequence[Trials]) -> tuple[SideBySide, list[Statement]]:
    """Return what vibrates with and without the condition, and what is calmer."""
    rows, calmer = [], []
    for payload_kg, setpoint_v in CASES:
        ours, rival = (
            [each[name, payload_kg] for each in trials] for name in ("pdpc", "pdpc_unconditional")
        )
        calmer.append(
            less(
                f"with {1e3 * payload_kg:.0f} g the base gauge vibrates less with the condition",
                [each.vibration_v for each in ours],
                [each.vibration_v for each in rival],
            )
        )
        rows.append(
            (
                f"{1e3 * payload_kg:.0f} g, {setpoint_v:g} V",
                spread([1e3 * each.vibration_v for each in ours], ".1f"),
                spread([1e3 * each.vibration_v for each in rival], ".1f"),
                spread([b.gauge_v / a.gauge_v for a, b in zip(ours, rival, strict=True)], ".2f"),
                p_text(calmer[-1].p_value),
            )
        )
    heading = columns(
        "step | conditional, mV | unconditional, mV | ratio as measured | conditional is calmer"
    )
    title = prose("chapter-4.vibration", at_rest_s=AT_REST_S, seeds=len(SEEDS))
    return SideBySide(title, heading, tuple(rows)), calmer


def tracking_table(trials: Sequence[Trials]) -> tuple[SideBySide, list[StepTrial]]:
    """Return how PDPC steps every payload, and all the steps."""
    rows, steps = [], []
    for payload_kg, setpoint_v in CASES:
        some = [each["pdpc", payload_kg] for each in trials]
        steps += some
        rows.append(
            (
                f"{1e3 * payload_kg:.0f} g, {setpoint_v:g} V",
                spread([each.mean_error_v for each in some]),
                spread([100.0 * each.overshoot for each in some], ".1f"),
                spread([min(each.settling_s, 10.0) for each in some], ".2f"),
            )
        )
    heading = ("step", "mean error over the last 2 s, V", "overshoot, %", "settling 5 %, s")
    return SideBySide(
        f"PDPC with the thesis's gains, {len(SEEDS)} seeds", heading, tuple(rows)
    ), steps


def _payloads(results: Results) -> Finding:
    table, steps = tracking_table(trials_of(results))
    runs = {
        f"{1e3 * kg:.0f} g": results[Call(pdpc_step, ("pdpc", kg, volts, SHOWN))]
        for kg, volts in CASES
    }
    time_s = next(iter(runs.values())).time_s
    plots = [
        _plot(
            f"{words} under PDPC with three payloads",
            time_s,
            {name: run.y[:, index] for name, run in runs.items()},
            words,
        )
        for words, index in (("position", 0), ("base strain", _BASE))
    ]
    judgement = elsewhere("claim-4-5", f"The {len(steps)} steps are judged at")
    return Finding(judgement, (table,), plots, (SETTLING_TEXT,))


def payload_judgement(steps: Sequence[StepTrial]) -> Judgement:
    """Judge whether one set of gains tracks with every payload."""
    error_v = max(abs(each.mean_error_v) for each in steps)
    overshoot = max(each.overshoot for each in steps)
    return judged(
        statements=(
            always(
                f"every payload reaches its set-point within {ZERO_ERROR_V:g} V",
                [abs(each.mean_error_v) <= ZERO_ERROR_V for each in steps],
            ),
        ),
        evidence=f"In {len(steps)} steps with 0, 200 and 400 g the error is at most {error_v:.3f} "
        f"V and the overshoot at most {overshoot:.1%}, with one set of gains.",
        reason="Friction decides where the smallest step ends.",
    )


def _square(results: Results) -> Finding:
    runs = [results[Call(pdpc_square, (seed,))] for seed in SEEDS[:5]]
    shown = runs[0].run
    plots = [
        _plot(
            f"{words} with 400 g, square wave of 5 V", shown.time_s, _signals(shown, index), words
        )
        for words, index in (("base strain", _BASE), ("middle strain", _MIDDLE))
    ]
    return Finding(
        suppression_judgement([(each.moving_v, each.resting_v) for each in runs]),
        plots=plots,
        text=(GAUGE_TEXT,),
    )


def suppression_judgement(swings: Sequence[tuple[float, float]]) -> Judgement:
    """Judge whether the vibration of each step dies before the next one."""
    shares = [resting_v / moving_v for moving_v, resting_v in swings]
    return judged(
        statements=(
            always(
                f"what vibrates dies out, to {DIES_OUT:.0%} of its first swing or less",
                [share <= DIES_OUT for share in shares],
            ),
        ),
        evidence=f"From 8 s after each step the base gauge swings by at most {max(shares):.1%} of "
        f"what it swings in the first 2 s (no noise, {len(swings)} seeds).",
        reason="The arm goes on swinging.",
    )


def _compensation(results: Results) -> Finding:
    trials = trials_of(results)
    rows, closer = [], []
    for payload_kg, setpoint_v in CASES:
        with_it, without = (
            [abs(each[name, payload_kg].mean_error_v) for each in trials]
            for name in ("pdpc", "pdp")
        )
        closer.append(less(f"with {1e3 * payload_kg:.0f} g the error is smaller", with_it, without))
        rows.append(
            (
                f"{1e3 * payload_kg:.0f} g, {setpoint_v:g} V",
                spread(with_it),
                spread(without),
                p_text(closer[-1].p_value),
            )
        )
    errors_v = [abs(each["pdpc", kg].mean_error_v) for each in trials for kg, _ in CASES]
    least_v = min(abs(each["pdp", kg].mean_error_v) for each in trials for kg, _ in CASES)
    heading = ("step", "with, V", "without, V", "with is closer")
    return Finding(
        tracking_judgement(errors_v, least_v, closer),
        (
            SideBySide(
                f"Tracking error with and without compensation, {len(SEEDS)} seeds",
                heading,
                tuple(rows),
            ),
        ),
        text=("That it should be conditional is claim-4-6.",),
    )


def tracking_judgement(
    errors_v: Sequence[float], without_v: float, closer: Sequence[Statement]
) -> Judgement:
    """Judge whether it takes the compensation to reach the set-point.

    `errors_v` are those of all steps with it, `without_v` is the least without.
    """
    zero = f"with the compensation the error is zero, within {ZERO_ERROR_V:g} V"
    return judged(
        statements=(*closer, always(zero, [each <= ZERO_ERROR_V for each in errors_v])),
        evidence=f"With compensation the error is at most {max(errors_v):.3f} V, without it at "
        f"least {without_v:.2f} V.",
        reason="The compensation does not decide the error.",
    )


def _robust(results: Results) -> Finding:
    table, steps = tracking_table(trials_of(results))
    return Finding(payload_judgement(steps), (table,), text=(SETTLING_TEXT,))


def _conditional(results: Results) -> Finding:
    vibration, calmer = vibration_table(trials_of(results))
    judgement = judged(statements=calmer, reason="Friction stops the arm either way.")
    return Finding(judgement, (vibration,), text=(GAUGE_TEXT,))


SUBJECTS = (
    subject(
        "figure-4-10",
        (
            *TRIALS,
            *(Call(pdpc_step, (name, 0.0, 1.0, SHOWN)) for name in ("pdpc", "pdpc_unconditional")),
        ),
        _strain,
    ),
    subject(
        "figure-4-11",
        (*TRIALS, *(Call(pdpc_step, ("pdpc", kg, volts, SHOWN)) for kg, volts in CASES)),
        _payloads,
    ),
    subject("figure-4-12", tuple(Call(pdpc_square, (seed,)) for seed in SEEDS[:5]), _square),
    subject("claim-4-3", TRIALS, _compensation),
    subject("claim-4-5", TRIALS, _robust),
    subject("claim-4-6", TRIALS, _conditional),
)
