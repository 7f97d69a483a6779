"""Choice 2-1: the number of block rows, which the thesis does not print."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from reproduction.chapter2.modes import MODES_HZ, RECORDS, gains, has_peak
from reproduction.chapter2.order_survey import (
    BLOCK_ROWS,
    ORDERS,
    TABLE_OF,
    candidates,
    fitted_half,
    identified,
    matched,
    model_of,
    printed_order,
    stability,
    thesis_record,
)
from reproduction.chapter2.tables import CLOSE
from reproduction.framework.findings import (
    SEEDS,
    Call,
    Finding,
    Judgement,
    SideBySide,
    Verdict,
    columns,
    prose,
    subject,
    thesis_table,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_ident import IoData
    from reproduction.framework.findings import Results

SWEPT = (15, 20, 30, 40, 60, 80)
SWEEP_SEEDS = SEEDS[:2]
MODES_ORDER = thesis_table("table_2_2")["order"]
EXAMPLE_STATES = max(
    row["order"] for row in thesis_table("chapter_3_models").values() if "msv" in row["reduced"]
)
"""States of the largest model that chapter 3 takes apart: (2-10) asks for more block rows."""
_PRINTED = {
    record: row for table in TABLE_OF.values() for record, row in thesis_table(table).items()
}


@dataclass(frozen=True)
class Swept:
    """Figures of one experiment with one number of block rows, means over `SWEEP_SEEDS`.

    Number of stable orders, mean and position error of the chosen model, the share of the seeds in
    which the printed order is stable or not as in the thesis, and the share of the arm's modes that
    a gauge of the model with 27 states has a peak at.
    """

    stable_orders: float
    mean_error: float
    position_error: float
    as_printed: float
    peaks: float


def swept(record: str) -> dict[int, Swept]:
    """Identify models of all orders with each number of block rows."""
    wholes = [thesis_record(record, seed) for seed in SWEEP_SEEDS]
    return {
        block_rows: Swept(*np.mean([_swept(record, each, block_rows) for each in wholes], axis=0))
        for block_rows in SWEPT
    }


def _swept(record: str, whole: IoData, block_rows: int) -> tuple[float, ...]:
    found = identified(fitted_half(whole), block_rows)
    stable = stability(found)
    errors = [matched(model_of(found, order)[0], whole).delta for order in candidates(stable)]
    best = min(errors, key=np.mean)
    order = printed_order(record)
    as_printed = stable[ORDERS.index(order)] == (order in _PRINTED[record]["stable"])
    response = gains(model_of(found, MODES_ORDER)[0])
    peaks = [has_peak(response, mode) for mode in MODES_HZ]
    figures = (stable.sum(), best.mean(), best[0], as_printed, np.mean(peaks))
    return tuple(map(float, figures))


class Agreement(NamedTuple):
    """Entries of one table that agree with one number of block rows, and what they are of."""

    counts: int
    errors: int
    orders: float
    experiments: int

    @property
    def entries(self) -> float:
        """Sum of the three kinds."""
        return self.counts + self.errors + self.orders


def agreement(found: Mapping[str, Swept]) -> Agreement:
    """Count the entries of a table that agree: numbers of stable orders, errors, printed orders."""
    counts = [
        (len(_PRINTED[record]["stable"]), each.stable_orders) for record, each in found.items()
    ]
    errors = [(_PRINTED[record]["mean"], each.mean_error) for record, each in found.items()]
    alike = [
        sum(theirs / CLOSE <= ours <= theirs * CLOSE for theirs, ours in pairs)
        for pairs in (counts, errors)
    ]
    as_printed = sum(each.as_printed for each in found.values())
    return Agreement(alike[0], alike[1], as_printed, len(found))


def _sweep(results: Results) -> Finding:
    found = {
        block_rows: {
            table: {
                record: results[Call(swept, (record,))][block_rows]
                for record in thesis_table(table)
            }
            for table in TABLE_OF.values()
        }
        for block_rows in SWEPT
    }
    agreements = {
        block_rows: {table: agreement(each) for table, each in tables.items()}
        for block_rows, tables in found.items()
    }
    headings = columns(prose("choice-2-1.columns"))
    tables = tuple(
        SideBySide(
            f"Table {table.removeprefix('table_').replace('_', '-')}, by block rows",
            headings,
            (
                _thesis_row(table),
                *(
                    _sweep_row(block_rows, found[block_rows][table], agreements[block_rows][table])
                    for block_rows in SWEPT
                ),
            ),
        )
        for table in TABLE_OF.values()
    )
    modes = SideBySide(
        "Table 2-2, by block rows: share of the arm's modes with a peak in a gauge",
        ("q", *RECORDS),
        tuple(
            (
                str(q),
                *(f"{found[q][TABLE_OF['O']][record].peaks:.0%}" for record in RECORDS.values()),
            )
            for q in SWEPT
        ),
    )
    totals = {q: sum(each.entries for each in agreements[q].values()) for q in SWEPT}
    return Finding(
        sweep_judgement(totals, 3 * len(_PRINTED)),
        (*tables, modes),
        text=(
            prose(
                "choice-2-1.text",
                block_rows=BLOCK_ROWS,
                states=EXAMPLE_STATES,
                seeds=len(SWEEP_SEEDS),
                close=CLOSE,
            ),
        ),
    )


def sweep_judgement(totals: Mapping[int, float], entries: int) -> Judgement:
    """Say how many entries agree with each number of block rows, and which has the most."""
    listed = ", ".join(f"{total:.1f} with {q}" for q, total in totals.items())
    enough = {q: total for q, total in totals.items() if q > EXAMPLE_STATES}
    best = max(enough, key=lambda q: enough[q])
    return Judgement(
        Verdict.OURS,
        f"q = {BLOCK_ROWS}. Of {entries} entries of the three tables there agree {listed}. Of "
        f"the numbers above {EXAMPLE_STATES} most agree with {best}.",
    )


def _thesis_row(table: str) -> tuple[str, ...]:
    rows = list(thesis_table(table).values())
    return (
        "thesis",
        f"{np.mean([len(row['stable']) for row in rows]):.1f}",
        "",
        f"{np.median([row['mean'] for row in rows]):.3f}",
        "",
        f"{np.median([row['delta'][0] for row in rows]):.3f}",
        "",
    )


def _sweep_row(block_rows: int, found: Mapping[str, Swept], alike: Agreement) -> tuple[str, ...]:
    surveys = list(found.values())
    return (
        str(block_rows),
        f"{np.mean([each.stable_orders for each in surveys]):.1f}",
        f"{alike.counts} of {alike.experiments}",
        f"{np.median([each.mean_error for each in surveys]):.3f}",
        f"{alike.errors} of {alike.experiments}",
        f"{np.median([each.position_error for each in surveys]):.3f}",
        f"{alike.orders / alike.experiments:.0%}",
    )


SUBJECTS = (
    subject(
        "choice-2-1",
        tuple(Call(swept, (record,)) for record in _PRINTED),
        _sweep,
    ),
)
