"""Figures 3-1 to 3-27: what the models of the first three examples look like in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.records.iodata import ARM_OUTPUTS
from flexarm_ident.report.plots.plots import match_plot
from reproduction.chapter3.reduction_calls import (
    INITIAL,
    RUNS_AWAY,
    Validation,
    both_calls,
    error_text,
    errors,
    ratios,
    trials,
)
from reproduction.chapter3.reduction_errors import RATIO_NEAR
from reproduction.chapter3.reduction_examples import EXAMPLES, TABLES
from reproduction.chapter3.reduction_rows import STAGES, reversed_pairs, thesis_rows
from reproduction.chapter3.reduction_stages import LOW, THESIS
from reproduction.framework.findings import Finding, Plot, SideBySide, judged
from reproduction.framework.sensors import SENSORS
from reproduction.framework.subjects import Subject
from reproduction.framework.thesis_values import thesis_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from reproduction.chapter3.reduction_rows import ThesisRow
    from reproduction.chapter3.reduction_stages import Curves, ReductionTrial
    from reproduction.framework.subjects import Results

DELTA_NEAR = 1.0 / 3.0
"""An error of a figure's output agrees within a third, or ..."""
DELTA_SMALL = 0.05
"""... within a twentieth of the signal, which no eye tells apart."""
GOOD = 1.25
"""A model looks like its full one up to this: the thesis calls 1.12 slightly worse and has 1.38 for
a model that deviates."""
POINTS = 600
_MEANING: Mapping[Validation, str] = {"dmv": "data matching", "sfv": "set-point following"}


@dataclass(frozen=True)
class FigureOf:
    """What a figure of the thesis draws."""

    number: str
    table: str
    stage: str
    validation: Validation


FIGURES: tuple[FigureOf, ...] = (
    FigureOf("3-1", "3-1", INITIAL, "dmv"),
    FigureOf("3-2", "3-1", INITIAL, "sfv"),
    FigureOf("3-3", "3-1", "msv", "dmv"),
    FigureOf("3-4", "3-1", "mrm", "dmv"),
    FigureOf("3-5", "3-1", "mrmc", "dmv"),
    FigureOf("3-6", "3-1", "updated", "dmv"),
    FigureOf("3-7", "3-1", "updated", "sfv"),
    FigureOf("3-9", "3-1", "further", "dmv"),
    FigureOf("3-10", "3-1", "further", "sfv"),
    FigureOf("3-11", "3-2", INITIAL, "dmv"),
    FigureOf("3-12", "3-2", INITIAL, "sfv"),
    FigureOf("3-13", "3-2", "mrm", "dmv"),
    FigureOf("3-14", "3-2", "msv", "dmv"),
    FigureOf("3-15", "3-2", "mrmc", "dmv"),
    FigureOf("3-16", "3-2", "updated", "dmv"),
    FigureOf("3-17", "3-2", "updated", "sfv"),
    FigureOf("3-18", "3-3", "unstable", "dmv"),
    FigureOf("3-19", "3-3", INITIAL, "dmv"),
    FigureOf("3-20", "3-3", INITIAL, "sfv"),
    FigureOf("3-21", "3-3", "mrm", "dmv"),
    FigureOf("3-22", "3-3", "msv", "dmv"),
    FigureOf("3-23", "3-3", "mrmc", "dmv"),
    FigureOf("3-24", "3-3", "updated", "dmv"),
    FigureOf("3-25", "3-3", "updated", "sfv"),
)


def compare_figure(
    figure: FigureOf,
    rows: Sequence[ThesisRow],
    low: Sequence[ReductionTrial],
    noisy: Sequence[ReductionTrial],
) -> Finding:
    """Draw a stage of an example and judge it by the errors that the thesis gives for its figure.

    A full model is judged by its four errors, a reduced one by what it costs.

    Parameters
    ----------
    figure
        What is drawn.
    rows
        The thesis's errors of the example.
    low, noisy
        Our results with little noise and with the thesis's; the verdict is on the second.
    """
    example = EXAMPLES[TABLES[figure.table]]
    stage, validation = figure.stage, figure.validation
    thesis = {(row.stage, row.validation): row for row in rows}
    theirs = np.array(thesis[stage, validation].delta)
    shown = next(trial for trial in noisy if trial.seed == example.shown_seed)
    drawn = np.array(getattr(shown.stages[stage], validation))
    ours = np.median(errors(noisy, stage, validation), axis=0)
    runaways = int(np.sum(errors(noisy, stage, validation).max(axis=1) > RUNS_AWAY))
    lost = (
        f" In {runaways} of {len(noisy)} records the loop runs away, for the reason at Table 3-6."
        if runaways
        else ""
    )
    cost = thesis[stage, validation].mean / thesis[INITIAL, validation].mean
    our_cost = float(np.median(ratios(noisy, stage, validation)))
    quiet_cost = float(np.median(ratios(low, stage, validation)))
    if stage in (INITIAL, "unstable"):
        near = np.abs(ours - theirs) <= np.maximum(DELTA_SMALL, DELTA_NEAR * theirs)
        turned = reversed_pairs(
            *(dict(zip(SENSORS, delta.tolist(), strict=True)) for delta in (theirs, ours))
        )
        judgement = judged(
            agrees=bool(near.all()),
            same_ranking=not turned,
            evidence=f"{int(near.sum())} of 4 errors agree ({_pairs(theirs, ours)}); "
            + (
                "; ".join(
                    f"ours matches the {worse} better than the {better}" for better, worse in turned
                )
                + ", the thesis's the other way round."
                if turned
                else "no two sensors are matched in another order than in the thesis."
            )
            + lost,
            reason=f"See Table {figure.table}b for what the errors of our full model rest on.",
        )
    else:
        judgement = judged(
            agrees=abs(our_cost / cost - 1.0) <= RATIO_NEAR,
            same_ranking=(our_cost > GOOD) == (cost > GOOD),
            evidence=f"The error is {_times(our_cost)} the full model's, the thesis's "
            f"{_times(cost)}; with little noise {_times(quiet_cost)}. Medians of {len(noisy)} "
            f"records.{lost}",
            reason=_other_cost(cost, our_cost, quiet_cost),
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


def _other_cost(cost: float, our_cost: float, quiet_cost: float) -> str:
    if cost > our_cost:
        return (
            "The noise of the gauges hides what is left out: with little noise the error grows "
            f"{_times(quiet_cost)}."
        )
    return "Our records depend more on the modes that are left out; no two rigs have the same ones."


def _caption(shown: ReductionTrial, code: str, stage: str) -> str:
    kept = shown.stages[stage].kept
    modes = f" and keeps modes {', '.join(kept)}" if kept else ""
    return (
        f"The model has {shown.stages[stage].order} states{modes}. It comes from the first half of "
        f"our record of {EXAMPLES[code].experiment} with seed {shown.seed} and strong noise."
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

    def build(results: Results) -> Finding:
        return compare_figure(
            figure,
            thesis_rows(thesis_table(f"table_{figure.table.replace('-', '_')}b")),
            trials(results, code, LOW),
            trials(results, code, THESIS),
        )

    return Subject(
        f"figure-{figure.number}",
        f"{code}, {STAGES[figure.stage]}: {_MEANING[figure.validation]}",
        both_calls(code),
        build,
    )


SUBJECTS: tuple[Subject, ...] = tuple(map(_subject, FIGURES))
