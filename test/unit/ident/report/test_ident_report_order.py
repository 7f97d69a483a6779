"""Tests of the words about the order."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident.report.content.blocks import Subject, Words
from flexarm_ident.report.content.wording import ranges
from flexarm_ident.report.sections.order import SECTION
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import arm_model, record


@pytest.mark.parametrize(
    ("order", "how"), [(4, "as asked for"), (None, "chosen by the errors of models of many orders")]
)
def test_order_section___words___tell_the_kinds_of_stability_apart(
    order: int | None, how: str
) -> None:
    data = record(arm_model(), 1500, 1, noise=0.02)
    outcome = run(data, Request(method="orse", order=order, block_rows=12, friction=False))
    found = outcome.identification

    words = [
        block.text
        for block in SECTION.build(Subject(outcome, "arm", {}))
        if isinstance(block, Words)
    ]

    first, _, diagram, model, *_ = words
    assert first.startswith(f"The full model has order {found.order}, {how}.")
    # Eleven of twelve block rows are the largest order.
    assert "the modes of the models of orders 7 to 11. A mode is called stable when the" in diagram
    stable = [
        n for n in range(7, 12) if np.abs(np.linalg.eigvals(found.subspace.matrices(n).A)).max() < 1
    ]
    assert model.endswith(f"models of these orders were so: {ranges(stable) or 'none'}.")
