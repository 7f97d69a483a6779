"""Tests of the words about the order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_ident import identify
from flexarm_ident.diagnostics.stabilisation import Stabilisation
from flexarm_ident.estimation.physical_modes import (
    JudgedMode,
    near_modes,
    standing_as,
    standings,
)
from flexarm_ident.estimation.plots import plot_stabilisation
from flexarm_ident.report.content.blocks import Subject, Table, Words
from flexarm_ident.report.content.wording import ranges
from flexarm_ident.report.plots.order_plots import stabilisation_plot
from flexarm_ident.report.sections.order import (
    SECTION,
    pair_words,
    recurring_table,
)
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import arm_model, record
from support.recurring_modes import NEIGHBOURS, judged


@pytest.mark.parametrize(
    ("order", "how"), [(4, "as asked for"), (None, "chosen by the errors of models of many orders")]
)
def test_order_section___words___distinguish_the_kinds_of_stability(
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
    assert "the modes of the models of orders 7 to 11. A mode stays when the" in diagram
    assert "stable" not in diagram
    stable = [
        n for n in range(7, 12) if np.abs(np.linalg.eigvals(found.subspace.matrices(n).A)).max() < 1
    ]
    assert model.endswith(f"the models of these orders were stable: {ranges(stable) or 'none'}.")


@pytest.mark.slow
def test_order_section___weighed_models___are_in_a_table_from_which_each_can_be_asked_for() -> None:
    # Sensors that are not linear leave more than noise, and models are weighed.
    data = record(arm_model(), 1500, 1, noise=0.02)
    bent = replace(data, y=data.y + 0.2 * np.abs(data.y))
    outcome = run(bent, Request(block_rows=24, friction=False))
    found = outcome.identification

    (table,) = [
        block
        for block in SECTION.build(Subject(outcome, "arm", {}))
        if isinstance(block, Table) and block.name == "weighed"
    ]

    assert [row[:2] for row in table.rows] == [(e.method, str(e.order)) for e in found.weighed]
    assert len(set(table.rows)) == len(table.rows) > len({row[0] for row in table.rows}) > 1
    (marked,) = (row for row, is_marked in zip(table.rows, table.marked, strict=True) if is_marked)
    assert (
        f"{marked[0]} of order {marked[1]} was chosen of {len(table.rows)} models" in found.choice
    )
    scores = [each.score for each in found.weighed]
    assert scores == sorted(scores)
    again = identify(outcome.records[0], method=marked[0], order=int(marked[1]), feedthrough=False)
    assert np.mean(again.fit_error) == pytest.approx(float(marked[2]), rel=0.1)


def test_recurring_table___two_physical_modes_at_one_place___are_no_two_modes_of_the_plant() -> (
    None
):
    modes = [judged(9.107), judged(43.25), judged(45.36)]
    assert near_modes(modes) == [(43.25, 45.36)]
    (words,) = pair_words(modes)
    assert words.startswith("43.25 and 45.36 Hz stand less than 6 % apart.")
    assert "possibly a split pole" in words
    reported = [row[-1] for row in recurring_table(modes).rows]
    assert reported == ["yes", "possibly a split pole", "possibly a split pole"]


EMPTY = Stabilisation((4, 5, 6), (), tuple(each.mode for each in NEIGHBOURS), 0.01)


def test_neighbours___are_the_same_in_the_table_and_in_both_diagrams() -> None:
    pytest.importorskip("matplotlib").use("Agg")
    assert standings(NEIGHBOURS) == ["physical", "split", "split", "noise"]

    axes = plot_stabilisation(EMPTY, NEIGHBOURS, 6, None)
    found = [(np.unique(line.get_xdata()).tolist(), line.get_linestyle()) for line in axes.lines]
    assert found[:3] == [([9.107], "-"), ([43.25], ":"), ([45.36], ":")]
    _, labels = axes.get_legend_handles_labels()
    assert labels[:2] == ["physical mode", "possibly a split pole"]

    words = "physical modes: 9.11 Hz; possibly a split pole: 43.2 Hz, 45.4 Hz"
    assert words in stabilisation_plot(
        EMPTY, standing_as("physical", NEIGHBOURS), split=standing_as("split", NEIGHBOURS)
    )


@pytest.mark.parametrize(
    "modes",
    [
        [judged(9.4), judged(24.1), judged(45.6)],
        [judged(43.25), judged(46.2)],
        [judged(48.0), judged(50.0, physical=False)],
        [],
    ],
    ids=["beam", "far enough", "hum beside a mode", "none"],
)
def test_recurring_table___modes_apart___have_no_warning(modes: list[JudgedMode]) -> None:
    assert pair_words(modes) == []
    reported = [row[-1] for row in recurring_table(modes).rows]
    assert reported == ["yes" if each.is_physical else "no" for each in modes]


@pytest.mark.parametrize(
    ("frequency_hz", "scatter_hz", "expected"),
    [
        (3.1000575, 5.4e-6, ("3.100", "< 0.001")),
        (25.0213, 0.4512, ("25.02", "0.45")),
        (0.57311, 0.00123, ("0.5731", "0.0012")),
        (12345.6, 70.4, ("12346", "70")),
    ],
)
def test_recurring_table___frequency___has_few_digits_and_no_deviation(
    frequency_hz: float, scatter_hz: float, expected: tuple[str, str]
) -> None:
    table = recurring_table([judged(frequency_hz, scatter_hz=scatter_hz, damping_scatter=1e-7)])
    (row,) = table.rows
    assert row[:4] == (*expected, "0.0412", "< 0.0001")
    assert table.header[:2] == ("Frequency, Hz", "Scatter over orders, Hz")
    assert not any("±" in cell for cell in row)
