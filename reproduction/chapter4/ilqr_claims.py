"""Claims 4-4 and 4-7: ILQR beside PDPC, and against friction (section 4.4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reproduction.chapter4.ilqr import (
    SETPOINTS_V,
    TEXT,
    needs_at,
    trials_at,
)
from reproduction.chapter4.ilqr_designs import PRINTED
from reproduction.framework.findings import SEEDS, Finding, SideBySide, columns, spread, subject
from reproduction.framework.verdicts import (
    Judgement,
    Statement,
    elsewhere,
    judged,
    less,
    p_text,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.framework.findings import Results


def _claim(results: Results) -> Finding:
    rows, better = [], {}
    for setpoint_v in SETPOINTS_V:
        trials = trials_at(results, setpoint_v)
        better[setpoint_v] = (
            less(
                f"PDPC has the smaller error with {setpoint_v:g} V",
                [abs(each.pdpc_error_v) for each in trials],
                [abs(each.error_v) for each in trials],
            ),
            less(
                f"PDPC has the smaller overshoot with {setpoint_v:g} V",
                [each.pdpc_overshoot for each in trials],
                [each.overshoot for each in trials],
            ),
        )
        rows.append(
            (
                f"{setpoint_v:g} V",
                spread([abs(each.pdpc_error_v) for each in trials]),
                spread([abs(each.error_v) for each in trials]),
                spread([100.0 * each.pdpc_overshoot for each in trials], ".1f"),
                spread([100.0 * each.overshoot for each in trials], ".1f"),
                p_text(better[setpoint_v][0].p_value),
            )
        )
    heading = columns(
        "step | error of PDPC, V | of ILQR, V | overshoot of PDPC, % | of ILQR, % | PDPC is closer"
    )
    return Finding(
        rivals_judgement(better),
        (SideBySide(f"PDPC and ILQR with 300 g, {len(SEEDS)} seeds", heading, tuple(rows)),),
        text=(
            "That ILQR needs one sensor is a matter of its structure: our `Ilqr` reads no other.",
        ),
    )


def rivals_judgement(better: Mapping[float, Sequence[Statement]]) -> Judgement:
    """Judge whether PDPC has the smaller error and the smaller overshoot at each set-point."""
    return judged(
        statements=[each for some in better.values() for each in some],
        evidence="ILQR has our weights here: with the thesis's the arm hunts, see figure-4-15.",
        reason="Our weights let ILQR approach the smaller set-point from below.",
    )


def _disturbance(results: Results) -> Finding:
    held, hunts = (trials_at(results, setpoint_v, PRINTED) for setpoint_v in SETPOINTS_V)
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
        elsewhere("figure-4-15 and figure-4-17", "What is held and what is not is judged at"),
        (
            SideBySide(
                f"ILQR with the thesis's weights and 300 g, {len(SEEDS)} seeds", heading, rows
            ),
        ),
        text=(TEXT,),
    )


SUBJECTS = (
    subject("claim-4-4", (*needs_at(SETPOINTS_V[0]), *needs_at(SETPOINTS_V[1])), _claim),
    subject(
        "claim-4-7",
        (*needs_at(SETPOINTS_V[0], PRINTED), *needs_at(SETPOINTS_V[1], PRINTED)),
        _disturbance,
    ),
)
