"""Tables 2-1, 2-3 and 2-4: stable orders and least errors of every experiment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from reproduction.chapter2.order_survey import ORDERS, survey
from reproduction.framework.evidence import LEVEL, OFTEN, SEEDS, p_text, spread
from reproduction.framework.findings import Finding, Judgement, SideBySide, judged
from reproduction.framework.subjects import Call, Subject
from reproduction.framework.thesis_values import thesis_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from reproduction.chapter2.order_survey import OrderSurvey
    from reproduction.framework.subjects import Results

CLOSE = 1.5
"""Errors agree within this factor: C_dat7 and C_dat10 of the thesis, which differ by a fifth in
gain and compensation, are further apart."""
MOST = 0.9
"""Share of the experiments that must agree; one in ten may have had a bad day on either rig."""
PRINTED_TO = 0.001
"""Means that depart further from those of the printed errors are misprints, not rounded."""
MANY = 0.5
"""Numbers of stable orders agree when those of more than this share of the experiments do."""

METHOD_TEXT = (
    "The simulated rig has sensor noise as strong as the thesis's. The records are prepared as in "
    "section 2.5, and identified by the thesis's ORSE from their first half; the error is that of "
    "data matching over the whole. Of the orders 7 to 36 the stable model with the least mean "
    "error is chosen. 20 seeds: median, and range in brackets."
)
_SUBJECTS = {
    "table-2-1": (
        "table_2_1",
        "open-loop experiments",
        (
            "The thesis's arm gave fewer stable models, with errors that its table does not "
            "explain; ours has the same friction and noise in every record."
        ),
    ),
    "table-2-3": (
        "table_2_3",
        "bounded position experiments",
        "The errors follow another noise and friction than ours.",
    ),
    "table-2-4": (
        "table_2_4",
        "closed-loop experiments",
        (
            "With payloads ours has fewer stable orders: up to half of the eigenvalues outside the "
            "unit circle are then of a bending mode near 20 Hz, which is hardly damped in our "
            "beam. And the thesis's best, C_dat7 and C_dat8, had a lower kp than the other records "
            "with 300 g; on our rig that excites less, and the errors are larger."
        ),
    ),
}


def survey_of(results: Results, record: str) -> OrderSurvey:
    """Look the survey of an experiment up."""
    found: OrderSurvey = results[Call(survey, (record,))]
    return found


def survey_calls(*records: str) -> tuple[Call, ...]:
    """Return the surveys of experiments."""
    return tuple(Call(survey, (record,)) for record in records)


def orders_text(orders: Iterable[int]) -> str:
    """Return orders as text, neighbours as a range.

    Examples
    --------
    >>> orders_text([7, 8, 9, 12])
    '7-9, 12'
    """
    runs: list[list[int]] = []
    for order in orders:
        if runs and order == runs[-1][-1] + 1:
            runs[-1].append(order)
        else:
            runs.append([order])
    texts = [str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    return ", ".join(texts) or "none"


def errors_judgement(
    printed: Mapping[str, float],
    ours: Mapping[str, float],
    *,
    stable: Mapping[str, tuple[float, float]] | None = None,
    reason: str,
) -> Judgement:
    """Judge errors of many models, and where it matters how many orders are stable.

    Parameters
    ----------
    printed, ours
        Mean error of each model in the thesis, and the median of ours.
    stable
        How many orders of each experiment are stable, in the thesis and in the mean of ours.
    reason
        Why ours differs, if it does.
    """
    ratios = np.array([ours[name] / printed[name] for name in printed])
    close = np.abs(np.log(ratios)) <= np.log(CLOSE)
    ranks = stats.spearmanr(list(printed.values()), [ours[name] for name in printed])
    ranked = bool(ranks.statistic > 0.0 and ranks.pvalue < LEVEL)
    as_many, words = True, ""
    if stable is not None:
        counts = np.array(list(stable.values()))
        thesis, mean = counts.mean(axis=0)
        alike = (counts[:, 0] / CLOSE <= counts[:, 1]) & (counts[:, 1] <= counts[:, 0] * CLOSE)
        as_many = bool(alike.mean() > MANY)
        words = (
            f" On the average {mean:.1f} orders are stable, {thesis:.1f} in the thesis; within "
            f"the same factor are {alike.sum()} of {len(alike)} experiments."
        )
    return judged(
        agrees=bool(close.mean() >= MOST and as_many),
        same_ranking=ranked,
        evidence=(
            f"{close.sum()} of {len(close)} mean errors are within a factor of {CLOSE:g} of the "
            f"thesis's; ours are {np.median(ratios):.2f} times as large in the median. The ranks "
            f"{'correlate' if ranked else 'do not correlate'} (Spearman {ranks.statistic:.2f}, "
            f"{p_text(float(ranks.pvalue))}).{words}"
        ),
        reason=reason,
    )


def _errors_text(errors: Iterable[float]) -> str:
    return " ".join(f"{error:.3f}" for error in errors)


def _misprints(printed: Mapping[str, Any]) -> Iterator[str]:
    means = {record: float(np.mean(row["delta"])) for record, row in printed.items()}
    wrong = [
        f"{record} (printed {printed[record]['mean']:.4f}, its errors make {mean:.4f})"
        for record, mean in means.items()
        if abs(mean - printed[record]["mean"]) > PRINTED_TO
    ]
    if wrong:
        yield (
            f"A mean of the thesis does not fit its four errors: {', '.join(wrong)}. The printed "
            "one is compared."
        )


def _table(name: str, reason: str) -> Callable[[Results], Finding]:
    def build(results: Results) -> Finding:
        printed = thesis_table(name)
        found = {record: survey_of(results, record) for record in printed}
        stable_rows, error_rows = [], []
        for record, row in printed.items():
            ours = found[record]
            often = np.array(ORDERS)[ours.stable.mean(axis=0) > OFTEN]
            stable_rows.append(
                (
                    record,
                    str(len(row["stable"])),
                    spread(ours.stable_orders, ".0f"),
                    orders_text(row["stable"]),
                    orders_text(often.tolist()),
                )
            )
            error_rows.append(
                (
                    record,
                    str(row["order"]),
                    spread(ours.chosen_orders, ".0f"),
                    _errors_text(row["delta"]),
                    _errors_text(np.median(ours.chosen_dmv, axis=0)),
                    f"{row['mean']:.3f}",
                    spread(ours.mean_dmv),
                )
            )
        judgement = errors_judgement(
            {record: row["mean"] for record, row in printed.items()},
            {record: float(np.median(each.mean_dmv)) for record, each in found.items()},
            stable={
                record: (float(len(row["stable"])), float(found[record].stable_orders.mean()))
                for record, row in printed.items()
            },
            reason=reason,
        )
        errors = SideBySide(
            "Errors of the chosen model: position, base gauge, middle gauge, speed; mean",
            ("record", "order, thesis", "ours", "errors, thesis", "ours", "mean, thesis", "ours"),
            tuple(error_rows),
        )
        orders = SideBySide(
            "Orders with a stable model",
            ("record", "how many, thesis", "ours", "which, thesis", "ours, in most of the seeds"),
            tuple(stable_rows),
        )
        return Finding(judgement, (errors, orders), text=(METHOD_TEXT, *_misprints(printed)))

    return build


SUBJECTS = tuple(
    Subject(
        key,
        f"Stable orders and least errors of the {kind}, {len(SEEDS)} seeds",
        survey_calls(*thesis_table(name)),
        _table(name, reason),
    )
    for key, (name, kind, reason) in _SUBJECTS.items()
)
