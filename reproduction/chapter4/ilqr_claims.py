"""Claims 4-4 and 4-7: ILQR beside PDPC, and against friction (section 4.4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reproduction.chapter4.ilqr import (
    SETPOINTS_V,
    TEXT,
    held_judgement,
    hunting_judgement,
    needs_at,
    trials_at,
)
from reproduction.chapter4.ilqr_designs import PRINTED, VARIANT_CALLS, hunting_variants
from reproduction.framework.findings import (
    LEVEL,
    SEEDS,
    Finding,
    Judgement,
    SideBySide,
    Verdict,
    columns,
    judged,
    p_text,
    sign_test,
    spread,
    subject,
)

if TYPE_CHECKING:
    from reproduction.framework.findings import Results


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
    printed = trials_at(results, SETPOINTS_V[0], PRINTED)
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
        disturbance_judgement(
            held_judgement(held, printed), hunting_judgement(hunts, hunting_variants(results))
        ),
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
    subject("claim-4-4", (*needs_at(SETPOINTS_V[0]), *needs_at(SETPOINTS_V[1])), _claim),
    subject(
        "claim-4-7",
        (
            *needs_at(SETPOINTS_V[0]),
            *needs_at(SETPOINTS_V[0], PRINTED),
            *needs_at(SETPOINTS_V[1]),
            *VARIANT_CALLS,
        ),
        _disturbance,
    ),
)
