"""Figures 4-15 to 4-18, claims 4-4 and 4-7: the ILQR law with 300 g (section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.laws.ilqr import Ilqr, design_ilqr
from flexarm_control.laws.registry import build_law
from flexarm_control.models.nominal_models import identified_model
from flexarm_control.simulation import simulate_loop
from flexarm_daq import RigParameters
from reproduction.framework.findings import (
    LEVEL,
    SEEDS,
    Call,
    Finding,
    Judgement,
    Plot,
    SideBySide,
    Subject,
    Verdict,
    columns,
    judged,
    p_text,
    prose,
    sign_test,
    spread,
    subject,
    thesis_table,
)
from reproduction.framework.plots import time_plot
from reproduction.framework.rig import step_to

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from reproduction.framework.findings import Results


SHOWN = 1
PAYLOAD_KG, LENGTH_S, LATE_S = 0.3, 20.0, 10.0
SETPOINTS_V = (3.0, 5.0)
HELD_V = 0.05
"""Swing, peak to peak, below which the arm counts as held; the sensors' noise is within it."""
OVERSHOOT = 0.06
HUNTS = 0.2
_FIGURES = (("4-15", 3.0, False), ("4-16", 3.0, True), ("4-17", 5.0, False), ("4-18", 5.0, True))
TEXT = prose("chapter-4.ilqr")


@dataclass(frozen=True)
class IlqrTrial:
    """Figures of one step under ILQR, and of the same step under PDPC.

    Swings are peak to peak, from 10 s on and over the last 2 s; errors are means over the last 2 s.
    """

    overshoot: float
    swing_v: float
    last_swing_v: float
    reversals: int
    error_v: float
    pdpc_error_v: float
    pdpc_overshoot: float


@dataclass(frozen=True)
class IlqrRun:
    """One step, simulated and implemented."""

    time_s: NDArray[np.float64]
    simulated_v: NDArray[np.float64]
    implemented_v: NDArray[np.float64]
    simulated_effort_v: NDArray[np.float64]
    implemented_effort_v: NDArray[np.float64]


def ilqr_trial(setpoint_v: float, seed: int) -> IlqrTrial:
    """Step 300 g under ILQR and under PDPC."""
    run, rival = (
        step_to(
            build_law(name),
            setpoint_v,
            arm=RigParameters(payload_kg=PAYLOAD_KG),
            seed=seed,
            length_s=LENGTH_S,
        )
        for name in ("ilqr", "pdpc")
    )
    position_v, true_v = run.y[:, 0], run.true_y[:, 0]
    figures = step_figures(run.time_s, position_v, setpoint_v)
    other = step_figures(rival.time_s, rival.y[:, 0], setpoint_v)
    return IlqrTrial(
        figures.overshoot,
        float(np.ptp(position_v[run.time_s >= LATE_S])),
        float(np.ptp(position_v[run.time_s >= LENGTH_S - 2.0])),
        _reversals(true_v),
        figures.mean_error_v,
        other.mean_error_v,
        other.overshoot,
    )


def _reversals(position_v: NDArray[np.float64]) -> int:
    """Count how often a motion of more than `HELD_V` turns into one of as much back."""
    turns, extreme, direction = 0, float(position_v[0]), 1.0
    for value in position_v.tolist():
        if (value - extreme) * direction > 0.0:
            extreme = value
        elif abs(value - extreme) > HELD_V:
            turns, extreme, direction = turns + 1, value, -direction
    return turns


def ilqr_run(setpoint_v: float, seed: int) -> IlqrRun:
    """Step the model and the rig with 300 g."""
    run = step_to(
        build_law("ilqr"),
        setpoint_v,
        arm=RigParameters(payload_kg=PAYLOAD_KG),
        seed=seed,
        length_s=LENGTH_S,
    )
    model = identified_model()
    simulated = simulate_loop(model, Ilqr(design_ilqr(model)), run.reference_v)
    return IlqrRun(
        run.time_s,
        np.array(simulated.y[:, 0], dtype=float),
        run.y[:, 0],
        np.array(simulated.effort, dtype=float),
        run.command_v,
    )


def needs_at(setpoint_v: float) -> tuple[Call, ...]:
    """Return the calls that `trials_at` takes its results from."""
    return tuple(Call(ilqr_trial, (setpoint_v, seed)) for seed in SEEDS)


def trials_at(results: Results, setpoint_v: float) -> list[IlqrTrial]:
    """Return the trials of every seed at one set-point."""
    return [results[call] for call in needs_at(setpoint_v)]


def _figure(setpoint_v: float, effort: bool, results: Results) -> Finding:  # noqa: FBT001
    run = results[Call(ilqr_run, (setpoint_v, SHOWN))]
    trials = trials_at(results, setpoint_v)
    signals = (
        {"implemented": run.implemented_effort_v, "simulated": run.simulated_effort_v}
        if effort
        else {"implemented": run.implemented_v, "simulated": run.simulated_v}
    )
    words = "control effort" if effort else "position"
    caption = f"{words} under ILQR with 300 g, {setpoint_v:g} V"
    rows = (
        ("overshoot, %", spread([100.0 * each.overshoot for each in trials], ".1f")),
        ("position from 10 to 20 s, peak to peak, V", spread([each.swing_v for each in trials])),
        ("times the arm turned round", spread([float(each.reversals) for each in trials], ".0f")),
    )
    judge = held_judgement if setpoint_v == SETPOINTS_V[0] else hunting_judgement
    gains, design = thesis_table("section_4_4"), design_ilqr(identified_model())
    note = prose(
        "chapter-4.ilqr_gains",
        kp=design.kp,
        thesis_kp=gains["kp"],
        ki=design.ki,
        thesis_ki=gains["ki"],
    )
    return Finding(
        judge(trials),
        (SideBySide(f"On the rig, {len(SEEDS)} seeds", ("", "ours"), rows),),
        (Plot(caption, time_plot(run.time_s, signals, f"{words}, V", caption)),),
        (TEXT, note),
    )


def held_judgement(trials: Sequence[IlqrTrial]) -> Judgement:
    """Judge the step of 3 V: held without overshoot."""
    overshoot, swing_v = (
        max(each.overshoot for each in trials),
        max(each.swing_v for each in trials),
    )
    return judged(
        agrees=overshoot <= OVERSHOOT and swing_v <= HELD_V,
        same_ranking=overshoot <= OVERSHOOT,
        evidence=f"The arm overshoots by at most {overshoot:.1%}, then stands within {swing_v:.3f} "
        "V: a friction that keeps its direction is held, as the thesis finds.",
        reason="The arm does not come to rest.",
    )


def hunting_judgement(trials: Sequence[IlqrTrial]) -> Judgement:
    """Judge the step of 5 V: the thesis's arm overshoots, reverses and goes on oscillating."""
    swing_v, last_v = (
        min(getattr(each, name) for each in trials) for name in ("swing_v", "last_swing_v")
    )
    turns, overshoot = (
        min(getattr(each, name) for each in trials) for name in ("reversals", "overshoot")
    )
    hunts = overshoot > OVERSHOOT and swing_v >= HUNTS and turns >= 1
    goes_on = last_v >= HUNTS
    return judged(
        agrees=hunts and goes_on,
        same_ranking=hunts,
        evidence=f"The arm overshoots by at least {overshoot:.0%}, reverses, and "
        f"still moves by {swing_v:.2f} V or more between 10 and 20 s: friction that changes "
        f"its direction is {'not held, as the thesis finds' if hunts else 'held'}. "
        + (
            "It goes on."
            if goes_on
            else f"In the last 2 s it moves by {last_v:.2f} V: ours dies out, the thesis's "
            "oscillation went on, which came out of no variant of our rig."
        ),
        reason="The thesis's arm overshoots, reverses and hunts.",
    )


def _claim(results: Results) -> Finding:
    rows, p_values = [], {}
    for setpoint_v in SETPOINTS_V:
        trials = trials_at(results, setpoint_v)
        p_values[setpoint_v] = sign_test(
            [abs(each.pdpc_error_v) for each in trials], [abs(each.error_v) for each in trials]
        )
        rows.append(
            (
                f"{setpoint_v:g} V",
                spread([abs(each.pdpc_error_v) for each in trials]),
                spread([abs(each.error_v) for each in trials]),
                spread([100.0 * each.pdpc_overshoot for each in trials], ".1f"),
                spread([100.0 * each.overshoot for each in trials], ".1f"),
                p_text(p_values[setpoint_v]),
            )
        )
    heading = columns(
        "step | error of PDPC, V | of ILQR, V | overshoot of PDPC, % | of ILQR, % | PDPC is closer"
    )
    overshoots = {
        setpoint_v: sign_test(
            [each.pdpc_overshoot for each in trials_at(results, setpoint_v)],
            [each.overshoot for each in trials_at(results, setpoint_v)],
        )
        for setpoint_v in SETPOINTS_V
    }
    return Finding(
        rivals_judgement(p_values, overshoots),
        (SideBySide(f"PDPC and ILQR with 300 g, {len(SEEDS)} seeds", heading, tuple(rows)),),
        text=(
            "That ILQR needs one sensor is a matter of its structure: our `Ilqr` reads no other.",
        ),
    )


def rivals_judgement(errors: dict[float, float], overshoots: dict[float, float]) -> Judgement:
    """Judge whether PDPC is the better one, by error or overshoot at each set-point."""
    better = [min(errors[volts], overshoots[volts]) < LEVEL for volts in errors]
    return judged(
        agrees=all(better),
        same_ranking=any(better),
        evidence="PDPC beside ILQR. "
        + "; ".join(
            f"{volts:g} V: {_smaller(errors[volts])} error ({p_text(errors[volts])}) and "
            f"{_smaller(overshoots[volts])} overshoot ({p_text(overshoots[volts])})"
            for volts in errors
        )
        + ".",
        reason="PDPC is better at neither set-point.",
    )


def _smaller(p_value: float) -> str:
    return "the smaller" if p_value < LEVEL else "not the smaller"


def _disturbance(results: Results) -> Finding:
    held, hunts = (trials_at(results, setpoint_v) for setpoint_v in SETPOINTS_V)
    rows = tuple(
        (
            f"{setpoint_v:g} V",
            spread([100.0 * each.overshoot for each in trials], ".1f"),
            spread([float(each.reversals) for each in trials], ".0f"),
            spread([each.swing_v for each in trials]),
            spread([each.last_swing_v for each in trials]),
        )
        for setpoint_v, trials in zip(SETPOINTS_V, (held, hunts), strict=True)
    )
    heading = ("step", "overshoot, %", "turns", "swing from 10 to 20 s, V", "in the last 2 s, V")
    return Finding(
        disturbance_judgement(held_judgement(held), hunting_judgement(hunts)),
        (SideBySide(f"ILQR on the rig with 300 g, {len(SEEDS)} seeds", heading, rows),),
        text=(TEXT,),
    )


def disturbance_judgement(held: Judgement, hunts: Judgement) -> Judgement:
    """Judge by both steps: what keeps its direction is held, and what reverses is not."""
    verdicts = (held.verdict, hunts.verdict)
    return judged(
        agrees=all(verdict is Verdict.AGREES for verdict in verdicts),
        same_ranking=Verdict.DIFFERS not in verdicts,
        evidence=f"3 V: {held.because} 5 V: {hunts.because}",
        reason="One of the two does not come out.",
    )


SUBJECTS = (
    *(
        Subject(
            f"figure-{number}",
            f"ILQR with 300 g, {setpoint_v:g} V: {'control effort' if effort else 'response'}",
            (*needs_at(setpoint_v), Call(ilqr_run, (setpoint_v, SHOWN))),
            partial(_figure, setpoint_v, effort),
        )
        for number, setpoint_v, effort in _FIGURES
    ),
    subject("claim-4-4", (*needs_at(SETPOINTS_V[0]), *needs_at(SETPOINTS_V[1])), _claim),
    subject("claim-4-7", (*needs_at(SETPOINTS_V[0]), *needs_at(SETPOINTS_V[1])), _disturbance),
)
