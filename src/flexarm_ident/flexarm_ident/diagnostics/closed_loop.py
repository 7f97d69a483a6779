"""Feedback: a controller made the inputs from the outputs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexarm_ident.diagnostics.check import Check
from flexarm_ident.diagnostics.input_answer import static_outputs
from flexarm_ident.records.data_warning import Grade, Kind
from flexarm_ident.subspace.feedback import feedback_test, reaches_inputs
from flexarm_ident.subspace.gram import block_gram

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_ident.diagnostics.check import Looked
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData


def feedback(data: Looked) -> Iterator[DataWarning]:
    """Yield that the loop is closed, as declared or as the inputs show."""
    records: Sequence[IoData] = data.records
    gram = data.gram
    declared = any(record.closed_loop for record in records)
    if not declared:
        # The answer of an output without dynamics cannot be told from that of a controller.
        static = {name for record in records for name in static_outputs(record)}
        dynamic = [name for name in records[0].outputs if name not in static]
        if not dynamic:
            return
        if static:
            records = [_with_outputs(record, dynamic) for record in records]
            gram = block_gram(records, gram.block_rows)
    test = feedback_test(records, gram, feedthrough=data.feedthrough)
    if not (test.detected or declared):
        return
    figures = {
        "statistic": test.statistic,
        "degrees": float(test.degrees),
        "p_value": test.p_value,
        "background": test.background,
    }
    biased = "plain ORSE is biased, and a small bias remains with the other methods"
    usual = f"chi-square {test.statistic:.0f} where {test.degrees} is usual"
    # The choice of a method takes account of later inputs.
    grade: Grade | None = Grade.INFORMATION
    if not test.detected:
        text = "closed-loop data: the record states it, and its noise is too small to show it; "
    elif declared or reaches_inputs(gram):
        though = "" if declared else ", though no loop is declared"
        text = f"closed-loop data: the inputs correlate with the outputs' noise, {usual}{though}; "
    else:
        grade = None
        biased = "fit D in the former case (feedthrough); a small bias remains in the latter"
        text = (
            "an output responds within a sample, or a controller answers within one: the "
            f"inputs of the same sample correlate with the outputs' noise, {usual}, later ones do "
            "not; "
        )
    yield _KIND(text + biased, figures, grade=grade)


def _with_outputs(record: IoData, names: Sequence[str]) -> IoData:
    """Return a record with some of its outputs."""
    columns = [record.outputs.index(name) for name in names]
    missing = None if record.missing is None else record.missing[:, columns]
    return replace(record, y=record.y[:, columns], outputs=tuple(names), missing=missing)


FEEDBACK = "feedback"
"""Code of the warning of a closed loop, which is not a defect."""
_KIND = Kind(
    FEEDBACK,
    "Closed loop",
    "the record says closed loop, or p < 1e-6 and 1.5 times the correlation at distant lags; "
    "without a declared loop, the text distinguishes inputs of the same sample from later ones",
    "`auto` or `pbsid`, not `orse`; of the same sample alone, `feedthrough`",
)
CHECKS = (Check(feedback, (_KIND,)),)
