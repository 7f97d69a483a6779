"""Tables 2-1 and 2-3 to 2-6: stable orders, least errors, special and typical models."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from reproduction.chapter2.easier_rigs import by_strength, free_calls
from reproduction.chapter2.order_survey import (
    ORDERS,
    TABLE_OF,
    counts_as_stable,
    fitted_half,
    identified,
    survey,
    thesis_record,
)
from reproduction.framework.findings import (
    OFTEN,
    SEEDS,
    Call,
    Finding,
    SideBySide,
    columns,
    prose,
    spread,
    subject,
    thesis_table,
)
from reproduction.framework.verdicts import BAND, Beside, Judgement, judged, mostly, ranked

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from reproduction.chapter2.order_survey import OrderSurvey
    from reproduction.framework.findings import Results

PRINTED_TO = 0.001
"""Means that depart further from those of the printed errors are misprints, not rounded."""
OPEN_LOOP = "table-2-1"
"""Table of the experiments that no law helps against friction."""
METHOD_TEXT = prose("chapter-2.method", least=ORDERS[0], most=ORDERS[-1], seeds=len(SEEDS))
PAIRS = {
    f"{kind}_dat{low}": f"{kind}_dat{high}"
    for kind, pairs in {
        "O": ((1, 3), (2, 4), (5, 7), (6, 8), (9, 11), (10, 12), (13, 14)),
        "B": ((1, 4), (2, 5), (3, 6), (7, 10), (8, 11), (9, 12)),
    }.items()
    for low, high in pairs
}
"""Experiments at 300 Hz and the same ones at 500 Hz."""
_SPECIAL = thesis_table("table_2_5")
_TYPICAL = thesis_table("table_2_6")


def survey_of(results: Results, record: str) -> OrderSurvey:
    """Look up the survey of an experiment."""
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
    """Judge errors of many models, and the mean numbers of stable orders where they are given."""
    pairs = (tuple(printed.values()), tuple(ours[name] for name in printed))
    figures, words = [Beside("mean errors", *pairs)], ""
    if stable is not None:
        counts = np.array(list(stable.values()))
        thesis, mean = counts.mean(axis=0)
        # Some experiments have no stable order at all.
        theirs, others = (counts + 1.0).T.tolist()
        figures.append(
            Beside("numbers of stable orders, with one added", tuple(theirs), tuple(others))
        )
        words = f"On the average {mean:.1f} orders are stable, {thesis:.1f} in the thesis."
    return judged(
        figures=figures,
        statements=(ranked("the errors rank as in the thesis", *pairs),),
        evidence=words,
        reason=reason,
    )


def _misprints(printed: Mapping[str, Any]) -> Iterator[str]:
    means = {record: float(np.mean(row["delta"])) for record, row in printed.items()}
    wrong = [
        f"{record} (printed {printed[record]['mean']:.4f}, its errors make {mean:.4f})"
        for record, mean in means.items()
        if abs(mean - printed[record]["mean"]) > PRINTED_TO
    ]
    if wrong:
        yield prose("chapter-2.misprints", wrong=", ".join(wrong))


def _errors_text(errors: Iterable[float]) -> str:
    return " ".join(f"{error:.3f}" for error in errors)


def _error_cells(row: Mapping[str, Any], ours: OrderSurvey) -> tuple[str, ...]:
    return (
        str(row["order"]),
        spread(ours.chosen_orders, ".0f"),
        _errors_text(row["delta"]),
        _errors_text(np.median(ours.chosen_dmv, axis=0)),
        f"{row['mean']:.3f}",
        spread(ours.mean_dmv),
    )


def _order_cells(row: Mapping[str, Any], ours: OrderSurvey) -> tuple[str, ...]:
    often = np.array(ORDERS)[ours.stable.mean(axis=0) > OFTEN]
    return (
        str(len(row["stable"])),
        spread(ours.stable_orders, ".0f"),
        orders_text(row["stable"]),
        orders_text(often.tolist()),
    )


def _table(key: str, name: str, results: Results) -> Finding:
    printed = thesis_table(name)
    found = {record: survey_of(results, record) for record in printed}
    means = {record: float(row["mean"]) for record, row in printed.items()}
    ours = {record: float(np.median(each.mean_dmv)) for record, each in found.items()}
    judgement = errors_judgement(
        means,
        ours,
        stable={
            record: (float(len(row["stable"])), float(found[record].stable_orders.mean()))
            for record, row in printed.items()
        },
        reason=prose(
            f"{key}.reason",
            leaving=leaving_text(found.values()),
            **_best(printed, found),
            **_apart(printed, found),
            **(by_strength(means, ours, results) if key == OPEN_LOOP else {}),
        ),
    )
    errors = SideBySide(
        "Errors of the chosen model: position, base gauge, middle gauge, speed; mean",
        ("record", "order, thesis", "ours", "errors, thesis", "ours", "mean, thesis", "ours"),
        tuple((record, *_error_cells(row, found[record])) for record, row in printed.items()),
    )
    orders = SideBySide(
        "Orders with a stable model",
        ("record", "how many, thesis", "ours", "which, thesis", "ours, in most of the seeds"),
        tuple((record, *_order_cells(row, found[record])) for record, row in printed.items()),
    )
    return Finding(judgement, (errors, orders), text=(METHOD_TEXT, *_misprints(printed)))


def _table_calls(key: str, name: str) -> tuple[Call, ...]:
    records = thesis_table(name)
    free = (call for record in records for call in free_calls(record))
    return (*survey_calls(*records), *(free if key == OPEN_LOOP else ()))


def leaving_text(found: Iterable[OrderSurvey]) -> str:
    """Say which eigenvalue makes the unstable models of some experiments unstable."""
    swinging = np.concatenate([each.swinging[~each.stable] for each in found])
    return prose("chapter-2.leaving", real=1.0 - np.mean(swinging)) if len(swinging) else ""


def _best(printed: Mapping[str, Any], found: Mapping[str, OrderSurvey]) -> dict[str, Any]:
    """Compare the thesis's two best records with the others of the same payload, in ours."""
    best = sorted(printed, key=lambda record: float(printed[record]["mean"]))[:2]
    payload_kg = experiment(best[0]).payload_kg
    rest = [
        record
        for record in found
        if record not in best and experiment(record).payload_kg == payload_kg
    ]
    ours_best, ours_rest = (
        [float(np.median(found[record].mean_dmv)) for record in some] for some in (best, rest)
    )
    return {
        "best": " and ".join(best),
        "payload_g": 1e3 * payload_kg,
        "ours_best": " and ".join(f"{error:.3f}" for error in ours_best),
        "ours_least": min(ours_rest),
        "ours_most": max(ours_rest),
    }


def _apart(
    printed: Mapping[str, Any], found: Mapping[str, OrderSurvey]
) -> dict[str, float | np.floating]:
    """Tell by what factor the same experiment differs at both rates, in the median and at most."""
    pairs = [(low, high) for low, high in PAIRS.items() if low in printed]
    if not pairs:
        return {}
    theirs = [printed[low]["mean"] / printed[high]["mean"] for low, high in pairs]
    ours = [np.median(found[low].mean_dmv) / np.median(found[high].mean_dmv) for low, high in pairs]
    return {
        f"{whose}_{which}": np.exp(choose(np.abs(np.log(ratios))))
        for whose, ratios in (("their", theirs), ("our", ours))
        for which, choose in (("middle", np.median), ("most", np.max))
    }


def special_stability(code: str) -> tuple[bool, ...]:
    """Tell for each seed whether a model of Table 2-5 is stable as it is identified."""
    row = _SPECIAL[code]
    halves = (
        fitted_half(thesis_record(row["record"], seed, row["compensation"])) for seed in SEEDS
    )
    return tuple(
        counts_as_stable(identified(half).subspace.matrices(row["order"]).A) for half in halves
    )


def _special(results: Results) -> Finding:
    found = {code: results[Call(special_stability, (code,))] for code in _SPECIAL}
    rows = tuple(
        (
            code,
            row["record"],
            "left in" if row["compensation"] == "keep" else "removed",
            str(row["order"]),
            "stable" if row["stable"] else "unstable",
            f"stable in {np.mean(found[code]):.0%} of the seeds",
        )
        for code, row in _SPECIAL.items()
    )
    headings = ("model", "record", "compensation", "order", "thesis", "ours")
    text = prose("table-2-5.text", seeds=len(SEEDS))
    table = SideBySide("Special models", headings, rows)
    return Finding(special_judgement(found), (table,), text=(text,))


def special_judgement(found: Mapping[str, Sequence[bool]]) -> Judgement:
    """Judge Table 2-5 by the seeds in which each model is stable."""
    as_printed = {
        code: [each == row["stable"] for each in found[code]] for code, row in _SPECIAL.items()
    }
    statements = {
        code: mostly(f"{code} is {'stable' if _SPECIAL[code]['stable'] else 'unstable'}", each)
        for code, each in as_printed.items()
    }
    rare = (
        f"our {code} in {np.mean(as_printed[code]):.0%} of the records"
        for code, each in statements.items()
        if not each.holds
    )
    return judged(
        statements=tuple(statements.values()),
        reason=prose("table-2-5.reason", listed=" and ".join(rare)),
    )


def _typical(results: Results) -> Finding:
    rows, printed, ours, chosen, ranges = [], {}, {}, {}, []
    for code, row in _TYPICAL.items():
        record, order = row["record"], row["order"]
        found = survey_of(results, record)
        means = found.printed_dmv.mean(axis=1)
        printed[code] = thesis_table(TABLE_OF[record[0]])[record]["mean"]
        ours[code] = float(np.median(means))
        chosen[record] = found.chosen_orders
        ranges.append(means.max() / means.min())
        rows.append(
            (
                code,
                record if row["printed"] == record else f"{record} (printed: {row['printed']})",
                str(row["samples"]),
                str(experiment(record).samples // 2),
                f"{found.stable_at(order).mean():.0%}",
                f"{printed[code]:.3f}",
                spread(means),
            )
        )
    headings = columns(prose("table-2-6.columns"))
    off = [code for code in printed if not 1.0 / BAND <= ours[code] / printed[code] <= BAND]
    widest = max(chosen, key=lambda record: int(np.ptp(chosen[record])))
    reason = prose(
        "table-2-6.reason",
        least=chosen[widest].min(),
        most=chosen[widest].max(),
        widest=widest,
        low=np.quantile(list(printed.values()), 0.25),
        high=np.quantile(list(printed.values()), 0.75),
        ours=np.median(ranges),
        off=len(off),
        open_loop=sum(_TYPICAL[code]["record"].startswith("O") for code in off),
    )
    text = prose("table-2-6.text")
    table = SideBySide("Typical models, orders as printed", headings, tuple(rows))
    return Finding(errors_judgement(printed, ours, reason=reason), (table,), text=(text,))


SUBJECTS = (
    *(
        subject(key, _table_calls(key, name), partial(_table, key, name))
        for key, name in ((name.replace("_", "-"), name) for name in TABLE_OF.values())
    ),
    subject("table-2-5", tuple(Call(special_stability, (code,)) for code in _SPECIAL), _special),
    subject(
        "table-2-6",
        survey_calls(*dict.fromkeys(row["record"] for row in _TYPICAL.values())),
        _typical,
    ),
)
