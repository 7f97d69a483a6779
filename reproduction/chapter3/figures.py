"""Figures 3-1 to 3-25: the models of the first three examples over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.records.iodata import ARM_OUTPUTS
from reproduction.chapter3.examples import (
    EXAMPLES,
    MEANING,
    STAGES,
    TABLES,
    Records,
    Validation,
    thesis_rows,
)
from reproduction.chapter3.trial import (
    RUNS_AWAY,
    both_calls,
    error_text,
    errors,
    records_of,
)
from reproduction.framework.findings import (
    SENSORS,
    Finding,
    Plot,
    SideBySide,
    Subject,
    prose,
    thesis_table,
)
from reproduction.framework.model_plots import match_plot
from reproduction.framework.verdicts import elsewhere

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from reproduction.chapter3.examples import Curves, ReductionTrial, ThesisRow
    from reproduction.framework.findings import Results


POINTS = 600


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


def compare_figure(figure: FigureOf, rows: Sequence[ThesisRow], found: Records) -> Finding:
    """Draw a stage, and list its errors beside those that its table judges."""
    example, _, noisy = found
    stage, validation = figure.stage, figure.validation
    (theirs,) = (np.array(row.delta) for row in rows if (row.stage, row.validation) == figure[2:])
    shown = found.shown(noisy=True)
    drawn = np.array(getattr(shown.stages[stage], validation))
    each = errors(noisy, stage, validation)
    ours, middle = np.median(each, axis=0), np.median(each.mean(axis=1))
    runaways = int(np.sum(each.max(axis=1) > RUNS_AWAY))
    if shown.curves is None:
        raise ValueError(f"{example.code}, seed {shown.seed}: nothing was kept to draw")
    return Finding(
        elsewhere(
            f"table-{figure.table}b",
            f"The loop runs away in {runaways} of {len(noisy)} records. The errors are judged with "
            "those of the other stages in",
        ),
        tables=(
            SideBySide(
                f"Errors of the {STAGES[stage]} model by {MEANING[validation]}",
                ("", *SENSORS, "mean"),
                tuple(
                    (label, *map(error_text, delta.tolist()), error_text(float(mean)))
                    for label, delta, mean in (
                        ("thesis", theirs, theirs.mean()),
                        (f"ours, drawn (seed {shown.seed})", drawn, drawn.mean()),
                        (f"ours, median of {len(noisy)} records", ours, middle),
                    )
                ),
            ),
        ),
        plots=_plots(shown.curves, stage, validation),
        text=(_caption(shown, example.code, stage),),
    )


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

    def build(results: Results) -> Finding:
        return compare_figure(figure, rows, records_of(results, code))

    return Subject(
        f"figure-{figure.number}",
        f"{code}, {STAGES[figure.stage]}: {MEANING[figure.validation]}",
        both_calls(code),
        build,
    )


SUBJECTS = tuple(map(_subject, FIGURES))
