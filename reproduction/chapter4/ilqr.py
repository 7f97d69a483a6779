"""Figures 4-15 to 4-18: the ILQR law with 300 g (section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.laws.ilqr import Ilqr
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.simulation import simulate_loop
from reproduction.chapter4.ilqr_designs import (
    HUNTS,
    OURS,
    PAYLOAD_KG,
    PRINTED,
    VARIANT_CALLS,
    hunting_variants,
    ilqr_design,
)
from reproduction.framework.findings import (
    SEEDS,
    Call,
    Finding,
    Plot,
    SideBySide,
    Subject,
    prose,
    spread,
    thesis_table,
)
from reproduction.framework.plots import time_plot
from reproduction.framework.rig import step_to
from reproduction.framework.study_rig import calm_rig
from reproduction.framework.verdicts import (
    Judgement,
    Statement,
    all_of,
    always,
    elsewhere,
    judged,
    mostly,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from reproduction.framework.findings import Results


SHOWN = 1
LENGTH_S, LATE_S = 20.0, 10.0
SETPOINTS_V = (3.0, 5.0)
HELD_V = 0.05
"""Swing, peak to peak, or overshoot, up to which the arm counts as held; noise is within it."""
_FIGURES = (("4-15", 3.0, False), ("4-16", 3.0, True), ("4-17", 5.0, False), ("4-18", 5.0, True))
TEXT = prose("chapter-4.ilqr")
DESIGNS = (OURS, PRINTED)


@dataclass(frozen=True)
class IlqrTrial:
    """Figures of one step under ILQR, and of the same step under PDPC.

    Swings are peak to peak, from 10 s on and over the last 2 s; errors are means over the last 2 s.
    The effort is its largest magnitude, and its swing over the last 2 s.
    """

    overshoot: float
    swing_v: float
    last_swing_v: float
    reversals: int
    error_v: float
    pdpc_error_v: float
    pdpc_overshoot: float
    effort_v: float
    effort_swing_v: float


@dataclass(frozen=True)
class IlqrRun:
    """One step, simulated and implemented."""

    time_s: NDArray[np.float64]
    simulated_v: NDArray[np.float64]
    implemented_v: NDArray[np.float64]
    simulated_effort_v: NDArray[np.float64]
    implemented_effort_v: NDArray[np.float64]


def ilqr_trial(design: str, setpoint_v: float, seed: int) -> IlqrTrial:
    """Step 300 g under one of the designs of ILQR and under PDPC."""
    run, rival = (
        step_to(
            law,
            setpoint_v,
            arm=calm_rig(PAYLOAD_KG),
            seed=seed,
            length_s=LENGTH_S,
        )
        for law in (Ilqr(ilqr_design(design)), Pdpc())
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
        float(np.abs(run.command_v).max()),
        float(np.ptp(run.command_v[run.time_s >= LENGTH_S - 2.0])),
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
    design = ilqr_design(PRINTED)
    run = step_to(
        Ilqr(design),
        setpoint_v,
        arm=calm_rig(PAYLOAD_KG),
        seed=seed,
        length_s=LENGTH_S,
    )
    simulated = simulate_loop(design.model, Ilqr(design), run.reference_v)
    return IlqrRun(
        run.time_s,
        np.array(simulated.y[:, 0], dtype=float),
        run.y[:, 0],
        np.array(simulated.effort, dtype=float),
        run.command_v,
    )


def needs_at(setpoint_v: float, design: str = OURS) -> tuple[Call, ...]:
    """Return the calls that `trials_at` takes its results from."""
    return tuple(Call(ilqr_trial, (design, setpoint_v, seed)) for seed in SEEDS)


def trials_at(results: Results, setpoint_v: float, design: str = OURS) -> list[IlqrTrial]:
    """Return the trials of every seed at one set-point."""
    return [results[call] for call in needs_at(setpoint_v, design)]


def _figure(setpoint_v: float, effort: bool, results: Results) -> Finding:  # noqa: FBT001
    run = results[Call(ilqr_run, (setpoint_v, SHOWN))]
    trials = {design: trials_at(results, setpoint_v, design) for design in DESIGNS}
    signals = (
        {"implemented": run.implemented_effort_v, "simulated": run.simulated_effort_v}
        if effort
        else {"implemented": run.implemented_v, "simulated": run.simulated_v}
    )
    words = "control effort" if effort else "position"
    caption = f"{words} under ILQR with 300 g, {setpoint_v:g} V"
    rows = (
        (
            "overshoot, %",
            *(_spread_of(some, "overshoot", 100.0, ".1f") for some in trials.values()),
        ),
        (
            "position from 10 to 20 s, peak to peak, V",
            *(_spread_of(some, "swing_v") for some in trials.values()),
        ),
        (
            "effort, largest, V",
            *(_spread_of(some, "effort_v", form=".2f") for some in trials.values()),
        ),
        (
            "effort in the last 2 s, peak to peak, V",
            *(_spread_of(some, "effort_swing_v", form=".2f") for some in trials.values()),
        ),
        (
            "times the arm turned round",
            *(_spread_of(some, "reversals", form=".0f") for some in trials.values()),
        ),
    )
    printed, ours = trials[PRINTED], trials[OURS]
    if effort:
        judgement = effort_judgement(setpoint_v, printed, ours)
    elif setpoint_v == SETPOINTS_V[0]:
        judgement = held_judgement(printed, ours, _gains_reason(thesis_table("section_4_4")["kp"]))
    else:
        both = {
            design: (trials_at(results, SETPOINTS_V[0], design), trials[design])
            for design in DESIGNS
        }
        listed = "; ".join(f"{arm} ({law})" for arm, law in hunting_variants(results)) or "none"
        judgement = hunting_judgement(both[PRINTED], both[OURS])
        judgement = replace(
            judgement, because=f"{judgement.because} Variants of choice 4-1 that go on: {listed}."
        )
    headings = ("", "our weights", "the thesis's weights")
    return Finding(
        judgement,
        (SideBySide(f"On the rig, {len(SEEDS)} seeds", headings, rows), _gain_table()),
        (Plot(caption, time_plot(run.time_s, signals, f"{words}, V", caption)),),
        (TEXT,),
    )


def _spread_of(
    trials: Sequence[IlqrTrial], name: str, factor: float = 1.0, form: str = ".3f"
) -> str:
    return spread([factor * getattr(each, name) for each in trials], form)


def _gain_table() -> SideBySide:
    printed = thesis_table("section_4_4")
    designs = [ilqr_design(name) for name in DESIGNS]
    return SideBySide(
        "Gains; the sign of a state is open",
        ("", "thesis", "ours", "ours with the thesis's weights, in ORSE coordinates"),
        (
            ("K_P", f"{printed['kp']:.4f}", *(f"{each.kp:.4f}" for each in designs)),
            ("K_I", f"{printed['ki']:g}", *(f"{each.ki:g}" for each in designs)),
            ("K_C(1)", f"{printed['kc'][0]:.4f}", *(f"{abs(each.kc[0]):.4f}" for each in designs)),
            (
                "L(1)",
                f"{printed['observer'][0]:.4f}",
                *(f"{abs(each.observer[0, 0]):.4f}" for each in designs),
            ),
        ),
    )


def _gains_reason(printed: float) -> str:
    made, ours = (ilqr_design(name).kp for name in (PRINTED, OURS))
    return prose("ilqr-gains.reason", made=made, ours=ours, printed=printed)


def held_judgement(
    printed: Sequence[IlqrTrial], ours: Sequence[IlqrTrial], gains: str = ""
) -> Judgement:
    """Judge the step of 3 V with the thesis's weights and K_I: the arm is held."""
    return judged(
        statements=_held(printed),
        evidence="Judged with the thesis's weights and K_I. With ours: "
        + "; ".join(each.text for each in _held(ours))
        + ".",
        reason=f"The swing at the end is {_median(printed, 'last_swing_v'):.3f} V with the "
        f"thesis's weights, {_median(ours, 'last_swing_v'):.3f} V with ours, medians. {gains}",
    )


def _held(trials: Sequence[IlqrTrial]) -> tuple[Statement, Statement]:
    return (
        always(
            f"the arm does not overshoot by more than {HELD_V:g} V",
            [each.overshoot * SETPOINTS_V[0] <= HELD_V for each in trials],
        ),
        always(
            f"it is held: from {LATE_S:g} s on it swings by {HELD_V:g} V at most",
            [each.swing_v <= HELD_V for each in trials],
        ),
    )


Steps: TypeAlias = "tuple[Sequence[IlqrTrial], Sequence[IlqrTrial]]"
"""Trials with 3 V and with 5 V under one law."""


def hunting_judgement(printed: Steps, ours: Steps) -> Judgement:
    """Judge the step of 5 V with the thesis's weights and K_I: the arm hunts, and not with 3 V."""
    contrasts = [_contrast(*steps) for steps in (printed, ours)]
    none = "No law of ours shows both. " * (not any(each.holds for each in contrasts))
    return judged(
        statements=(*_hunting(printed[1]), contrasts[0]),
        evidence=f"{none}Judged with the thesis's weights and K_I. With ours: "
        + "; ".join(each.text for each in (*_hunting(ours[1]), contrasts[1]))
        + ".",
        reason="With the thesis's weights the swing at the end is "
        + " and ".join(
            f"{_median(some, 'last_swing_v'):.3f} V with {volts:g} V"
            for some, volts in zip(printed, SETPOINTS_V, strict=True)
        )
        + ", medians.",
    )


def _hunting(trials: Sequence[IlqrTrial]) -> tuple[Statement, Statement, Statement]:
    return (
        mostly(
            f"the arm overshoots by more than {HELD_V:g} V",
            [each.overshoot * SETPOINTS_V[1] > HELD_V for each in trials],
        ),
        mostly("it reverses", [each.reversals >= 1 for each in trials]),
        mostly(
            f"it goes on swinging, by {HUNTS:g} V or more at the end",
            [each.last_swing_v >= HUNTS for each in trials],
        ),
    )


def _contrast(held: Sequence[IlqrTrial], hunts: Sequence[IlqrTrial]) -> Statement:
    """Return the thesis's point: the same law holds the arm with 3 V, and cycles with 5 V."""
    low_v, high_v = SETPOINTS_V
    return all_of(
        f"one law holds the arm with {low_v:g} V and hunts with {high_v:g} V",
        [
            always(f"{low_v:g} V", [each.swing_v <= HELD_V for each in held]),
            mostly(f"{high_v:g} V", [each.last_swing_v >= HUNTS for each in hunts]),
        ],
    )


def effort_judgement(
    setpoint_v: float, printed: Sequence[IlqrTrial], ours: Sequence[IlqrTrial]
) -> Judgement:
    """Refer to the response: the thesis says nothing of the effort but that it swings as that."""
    number = next(each for each, volts, effort in _FIGURES if volts == setpoint_v and not effort)
    swings = (
        f"{_median(some, 'effort_v'):.2f} V at most and {_median(some, 'effort_swing_v'):.2f} V "
        f"peak to peak at the end with {whose} weights"
        for some, whose in ((printed, "the thesis's"), (ours, "our"))
    )
    return elsewhere(
        f"figure-{number}",
        f"The effort is {', '.join(swings)}, medians. Whether the arm hunts is judged at",
    )


def _median(trials: Sequence[IlqrTrial], name: str) -> float:
    return float(np.median([getattr(each, name) for each in trials]))


SUBJECTS = tuple(
    Subject(
        f"figure-{number}",
        f"ILQR with 300 g, {setpoint_v:g} V: {'control effort' if effort else 'response'}",
        (
            *(
                call
                for each in SETPOINTS_V
                for design in DESIGNS
                for call in needs_at(each, design)
            ),
            Call(ilqr_run, (setpoint_v, SHOWN)),
            *VARIANT_CALLS,
        ),
        partial(_figure, setpoint_v, effort),
    )
    for number, setpoint_v, effort in _FIGURES
)
