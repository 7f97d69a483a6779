"""Tables 2-5 and 2-6: the models that chapters 3 and 4 use."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.models.poles import is_stable
from reproduction.chapter2.order_survey import TABLE_OF, fitted_half, identified, thesis_record
from reproduction.chapter2.survey_tables import errors_judgement, survey_calls, survey_of
from reproduction.framework.evidence import OFTEN, SEEDS, spread
from reproduction.framework.findings import Finding, Judgement, SideBySide, judged
from reproduction.framework.subjects import Call, Subject
from reproduction.framework.thesis_values import thesis_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from reproduction.framework.subjects import Results

_SPECIAL = thesis_table("table_2_5")
_TYPICAL = thesis_table("table_2_6")


def special_stability(code: str) -> tuple[bool, ...]:
    """Tell of each seed whether a model of Table 2-5 is stable as it is identified."""
    row = _SPECIAL[code]
    return tuple(
        is_stable(
            identified(fitted_half(thesis_record(row["record"], seed, row["compensation"])))
            .subspace.matrices(row["order"])
            .A
        )
        for seed in SEEDS
    )


def _special(results: Results) -> Finding:
    shares = {code: float(np.mean(results[Call(special_stability, (code,))])) for code in _SPECIAL}
    rows = tuple(
        (
            code,
            row["record"],
            "left in" if row["compensation"] == "keep" else "removed",
            str(row["order"]),
            "stable" if row["stable"] else "unstable",
            f"stable in {shares[code]:.0%} of the seeds",
        )
        for code, row in _SPECIAL.items()
    )
    headings = ("model", "record", "compensation", "order", "thesis", "ours")
    return Finding(
        special_judgement(shares),
        (SideBySide("Special models", headings, rows),),
        text=(
            (
                "Whether one model is stable is a matter of the noise of one record: so ours are "
                "identified from 20 records."
            ),
        ),
    )


def special_judgement(shares: Mapping[str, float]) -> Judgement:
    """Judge Table 2-5 by the share of the seeds in which each model is stable."""
    as_printed = [code for code, row in _SPECIAL.items() if (shares[code] > OFTEN) == row["stable"]]
    stable = [shares[code] for code, row in _SPECIAL.items() if row["stable"]]
    unstable = [shares[code] for code, row in _SPECIAL.items() if not row["stable"]]
    ranked = min(stable) > max(unstable)
    words = ", ".join(f"{code} {share:.0%}" for code, share in shares.items())
    return judged(
        agrees=len(as_printed) == len(shares),
        same_ranking=ranked,
        evidence=(
            f"Stable: {words} of the seeds. {len(as_printed)} of {len(shares)} are in most seeds "
            "what the thesis says."
            + ("" if not ranked else " The one it calls unstable is so more often than the others.")
        ),
        reason=(
            "The eigenvalue that leaves the unit circle is the real one of the rigid motion, which "
            "is at 1 to within 0.001 in all of these models: the noise of the one record decides "
            "on which side of the circle it lies, and the thesis shows one record."
        ),
    )


def _typical(results: Results) -> Finding:
    rows, printed, ours = [], {}, {}
    for code, row in _TYPICAL.items():
        record, order = row["record"], row["order"]
        found = survey_of(results, record)
        means = found.printed_dmv.mean(axis=1)
        printed[code] = thesis_table(TABLE_OF[record[0]])[record]["mean"]
        ours[code] = float(np.median(means))
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
    headings = (
        "model",
        "record",
        "first samples, thesis",
        "half of ours",
        "stable, ours",
        "mean error, thesis",
        "ours",
    )
    return Finding(
        errors_judgement(
            printed,
            ours,
            reason=(
                "Which order is best is a chance of one record (ours range from 8 to 36 over the "
                "seeds of one experiment). At a printed order ours is often unstable, and moving "
                "its eigenvalues costs accuracy; and the experiments differ less from each other "
                "than the two rigs do."
            ),
        ),
        (SideBySide("Typical models, orders as printed", headings, tuple(rows)),),
        text=(
            (
                "Each model has the order that the thesis chose. Where ours is not stable at that "
                "order, its eigenvalues are moved inside the unit circle. From Ao5_12 on the "
                "printed table names wrong records: code and order belong to the records that are "
                "taken here, and the length does but for Ao14_31."
            ),
        ),
    )


SUBJECTS = (
    Subject(
        "table-2-5",
        "Special models: compensation left in, or unstable",
        tuple(Call(special_stability, (code,)) for code in _SPECIAL),
        _special,
    ),
    Subject(
        "table-2-6",
        "Typical models of the later chapters",
        survey_calls(*dict.fromkeys(row["record"] for row in _TYPICAL.values())),
        _typical,
    ),
)
