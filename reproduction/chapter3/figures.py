"""Figures 3-1 to 3-25: the models of the first three examples over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.records.iodata import ARM_OUTPUTS
from reproduction.chapter3.costs import RATIO_NEAR
from reproduction.chapter3.drift import DRIFTING, drift_calls, drift_reason
from reproduction.chapter3.examples import (
    EXAMPLES,
    INITIAL,
    STAGES,
    TABLES,
    Records,
    Validation,
    reversed_pairs,
    thesis_rows,
)
from reproduction.chapter3.left_out import left_out_reason
from reproduction.chapter3.trial import (
    RUNS_AWAY,
    both_calls,
    error_text,
    errors,
    ratios,
    records_of,
)
from reproduction.framework.findings import (
    SENSORS,
    Finding,
    Plot,
    SideBySide,
    Subject,
    judged,
    prose,
    thesis_table,
)
from reproduction.framework.model_plots import match_plot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from reproduction.chapter3.examples import Curves, ReductionTrial, ThesisRow
    from reproduction.framework.findings import Results


DELTA_NEAR = 1.0 / 3.0
"""An error of a figure's output agrees within a third, or ..."""
DELTA_SMALL = 0.05
"""... within a twentieth of the signal, which no eye tells apart."""
GOOD = 1.25
"""A model looks like its full one up to this: the thesis calls 1.12 slightly worse and has 1.38 for
a model that deviates."""
POINTS = 600
FULL = (INITIAL, "unstable")
"""Stages that nothing was left out of."""
_MEANING: Mapping[Validation, str] = {"dmv": "data matching", "sfv": "set-point following"}


class FigureOf(NamedTuple):
    """Contents of a figure of the thesis: the table with its errors, a stage, a validation."""

    number: str
    table: str
    stage: str
    validation: Validation


_DRAWN = {
    "3-1": """1 initial dmv, 2 initial sfv, 3 msv dmv, 4 mrm dmv, 5 mrmc dmv, 6 updated dmv,
        7 updated sfv, 9 further dmv, 10 further sfv""",
    "3-2": """11 initial dmv, 12 initial sfv, 13 mrm dmv, 14 msv dmv, 15 mrmc dmv, 16 updated dmv,
        17 updated sfv""",
    "3-3": """18 unstable dmv, 19 initial dmv, 20 initial sfv, 21 mrm dmv, 22 msv dmv, 23 mrmc dmv,
        24 updated dmv, 25 updated sfv""",
}
"""Figures by the table that has their errors: number, stage and validation of each."""
FIGURES = tuple(
    FigureOf(f"3-{number}", table, stage, "sfv" if validation == "sfv" else "dmv")
    for table, words in _DRAWN.items()
    for number, stage, validation in map(str.split, words.split(","))
)


def compare_figure(
    figure: FigureOf, rows: Sequence[ThesisRow], found: Records, drift: str = ""
) -> Finding:
    """Draw a stage and judge its four errors, and of a reduced model the cost as well.

    `drift` says what makes the position's error of a full model, for the reason.
    """
    example, low, noisy = found
    stage, validation = figure.stage, figure.validation
    thesis = {(row.stage, row.validation): row for row in rows}
    theirs = np.array(thesis[stage, validation].delta)
    shown = found.shown(noisy=True)
    drawn = np.array(getattr(shown.stages[stage], validation))
    ours = np.median(errors(noisy, stage, validation), axis=0)
    runaways = int(np.sum(errors(noisy, stage, validation).max(axis=1) > RUNS_AWAY))
    lost = (
        f" In {runaways} of {len(noisy)} records the loop runs away, for the reason at Table 3-6."
        if runaways
        else ""
    )
    cost = thesis[stage, validation].mean / thesis[INITIAL, validation].mean
    our_costs = ratios(noisy, stage, validation)
    our_cost = float(np.median(our_costs))
    quiet_cost = float(np.median(ratios(low, stage, validation)))
    near = np.abs(ours - theirs) <= np.maximum(DELTA_SMALL, DELTA_NEAR * theirs)
    agreeing = f"{int(near.sum())} of {len(near)} errors agree ({_pairs(theirs, ours)})"
    if stage in FULL:
        turned = reversed_pairs(
            *(dict(zip(SENSORS, delta.tolist(), strict=True)) for delta in (theirs, ours))
        )
        judgement = judged(
            agrees=bool(near.all()),
            same_ranking=not turned,
            evidence=f"{agreeing}; "
            + (
                "; ".join(
                    f"ours matches the {worse} better than the {better}" for better, worse in turned
                )
                + ", the thesis's the other way round."
                if turned
                else "no two sensors are matched in another order than in the thesis."
            )
            + lost,
            reason=prose("figure-3-x.full_reason", table=figure.table, drift=drift),
        )
    else:
        judgement = judged(
            agrees=abs(our_cost / cost - 1.0) <= RATIO_NEAR and bool(near.all()),
            same_ranking=(our_cost > GOOD) == (cost > GOOD),
            evidence=f"The error is {_times(our_cost)} the full model's, the thesis's "
            f"{_times(cost)}; with little noise {_times(quiet_cost)}. {agreeing}. Medians of "
            f"{len(noisy)} records.{lost}",
            reason=_other_cost(cost, our_costs, quiet_cost)
            + _left_out(figure, noisy, cheaper=our_cost < cost),
        )
    if shown.curves is None:
        raise ValueError(f"{example.code}, seed {shown.seed}: nothing was kept to draw")
    return Finding(
        judgement,
        tables=(
            SideBySide(
                f"Errors of the {STAGES[stage]} model by {_MEANING[validation]}",
                ("", *SENSORS, "mean"),
                tuple(
                    (label, *map(error_text, delta.tolist()), error_text(float(delta.mean())))
                    for label, delta in (
                        ("thesis", theirs),
                        (f"ours, drawn (seed {shown.seed})", drawn),
                        (f"ours, median of {len(noisy)} records", ours),
                    )
                ),
            ),
        ),
        plots=_plots(shown.curves, stage, validation),
        text=(_caption(shown, example.code, stage),),
    )


def _times(ratio: float) -> str:
    return f"{ratio:.2f} times" if ratio < RUNS_AWAY else "many times"


def _pairs(theirs: np.ndarray, ours: np.ndarray) -> str:
    return "ours / thesis's: " + ", ".join(
        f"{name} {error_text(our)} / {their:.3f}"
        for name, their, our in zip(SENSORS, theirs.tolist(), ours.tolist(), strict=True)
    )


def _other_cost(cost: float, our_costs: NDArray[np.float64], quiet_cost: float) -> str:
    our_cost = float(np.median(our_costs))
    if cost > our_cost:
        return prose("figure-3-x.reason", growth=_times(quiet_cost))
    return prose(
        "figure-3-x.more_reason",
        growth=_times(quiet_cost),
        share="all" if quiet_cost >= our_cost else "part",
        least=_times(our_costs.min()),
        most=_times(our_costs.max()),
        nearer=int(np.sum(our_costs <= cost)),
        records=len(our_costs),
    )


def _left_out(figure: FigureOf, noisy: Sequence[ReductionTrial], *, cheaper: bool) -> str:
    """Say which mode is left out, where that costs less than in the thesis."""
    if not cheaper or figure.stage not in ("msv", "mrmc"):
        return ""
    return f" {left_out_reason(figure.table, noisy, figure.stage)}"


def _caption(shown: ReductionTrial, code: str, stage: str) -> str:
    kept = shown.stages[stage].kept
    modes = f" and keeps modes {', '.join(kept)}" if kept else ""
    return prose(
        "figure-3-x.caption",
        states=shown.stages[stage].order,
        modes=modes,
        record=EXAMPLES[code].experiment,
        seed=shown.seed,
    )


def _plots(curves: Curves, stage: str, validation: Validation) -> tuple[Plot, ...]:
    measured = curves.measured if validation == "dmv" else curves.set_point
    simulated = (curves.dmv if validation == "dmv" else curves.sfv)[stage]
    time_s: NDArray[np.float64] = np.arange(len(measured), dtype=float) * curves.dt_s
    fitted_s = 0.5 * len(measured) * curves.dt_s if validation == "dmv" else 0.0
    return tuple(
        Plot(
            f"{letter}: {sensor}",
            match_plot(
                time_s,
                measured[:, k].astype(float),
                simulated[:, k].astype(float),
                name,
                fitted_s=fitted_s,
                points=POINTS,
            ),
        )
        for k, (letter, sensor, name) in enumerate(zip("abcd", SENSORS, ARM_OUTPUTS, strict=True))
    )


def _subject(figure: FigureOf) -> Subject:
    code = TABLES[figure.table]
    rows = thesis_rows(thesis_table(f"table_{figure.table.replace('-', '_')}b"))
    is_full = figure.stage in FULL and figure.validation == "dmv"
    drifts = is_full and figure.table in DRIFTING

    def build(results: Results) -> Finding:
        (theirs,) = (row.delta[0] for row in rows if (row.stage, row.validation) == figure[2:])
        drift = drift_reason(code, results, theirs) if drifts else ""
        return compare_figure(figure, rows, records_of(results, code), drift)

    return Subject(
        f"figure-{figure.number}",
        f"{code}, {STAGES[figure.stage]}: {_MEANING[figure.validation]}",
        both_calls(code) + (drift_calls(code) if drifts else ()),
        build,
    )


SUBJECTS = tuple(map(_subject, FIGURES))
