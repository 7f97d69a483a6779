"""Rules of the verdicts, and the pages that they made."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from reproduction.framework.verdicts import (
    LEVEL,
    Beside,
    Statement,
    Verdict,
    all_of,
    always,
    any_of,
    judged,
    less,
    mostly,
    ranked,
)
from support.project import PROJECT

THESIS = (0.1, 0.2, 0.4, 0.8)
NEAR = Beside("errors", THESIS, (0.11, 0.19, 0.42, 0.75))
LEVELLED = Beside("errors", (0.30, 0.32, 0.34, 0.36), (0.36, 0.30, 0.39, 0.31))
FAR = Beside("errors", THESIS, (0.8, 0.4, 0.2, 0.1))
HOLDS, OPEN, REVERSED = (
    Statement("a", 0.01, 1.0),
    Statement("b", 0.3, 0.8),
    Statement("c", 1.0, 0.01),
)
INDEX = PROJECT / "docs" / "reproduction" / "index.md"


@pytest.mark.parametrize(
    ("figures", "statements", "verdict"),
    [
        ([NEAR], [HOLDS], Verdict.AGREES),
        ([NEAR], [], Verdict.AGREES),
        ([], [HOLDS, HOLDS], Verdict.AGREES),
        ([FAR], [HOLDS], Verdict.SAME_CONCLUSIONS),
        ([LEVELLED], [], Verdict.PARTLY),
        ([NEAR], [OPEN], Verdict.PARTLY),
        ([FAR], [HOLDS, OPEN], Verdict.PARTLY),
        ([], [OPEN], Verdict.DIFFERS),
        ([FAR], [], Verdict.DIFFERS),
        ([NEAR], [HOLDS, REVERSED], Verdict.DIFFERS),
    ],
)
def test_judged___parts___make_the_verdict(
    figures: list[Beside], statements: list[Statement], verdict: Verdict
) -> None:
    found = judged(figures=figures, statements=statements, reason="The reason.")
    assert found.verdict is verdict
    assert ("The reason." in found.because) == (verdict in (Verdict.PARTLY, Verdict.DIFFERS))


def test_judged___every_combination___agrees_only_above_a_constant_and_unreversed() -> None:
    for figures in itertools.product((NEAR, LEVELLED, FAR), repeat=2):
        for statements in itertools.product((HOLDS, OPEN, REVERSED), repeat=2):
            found = judged(figures=figures, statements=statements)
            if found.verdict is Verdict.AGREES:
                assert all(each.distance < each.constant_distance for each in figures)
            if found.verdict in (Verdict.AGREES, Verdict.SAME_CONCLUSIONS):
                assert all(each.p_value < LEVEL for each in statements)


def test_judged___without_parts___is_refused() -> None:
    with pytest.raises(ValueError, match="cannot be judged"):
        judged(evidence="Nothing.")


def test_beside___distances___are_those_of_a_calculation_by_hand() -> None:
    # Off by the factors 2, 1 and 4; the best constant is 2, off by 2, 1 and 2.
    found = Beside("errors", (1.0, 2.0, 4.0), (2.0, 2.0, 1.0))
    assert found.within == 1
    assert found.distance == pytest.approx(2.0)
    assert found.constant_distance == pytest.approx(2.0 ** (2.0 / 3.0))
    assert not found.agrees


def test_beside___runaway___is_no_agreement() -> None:
    found = Beside("errors", THESIS, (0.1, 0.2, 0.4, float("inf")))
    assert found.within == 3
    assert not found.agrees
    assert "no finite factor" in found.text


def test_statements___of_pairs___hold_stay_open_or_are_reversed() -> None:
    low, high = [0.1] * 10, [0.2] * 10
    assert less("", low, high).holds
    assert less("", high, low).is_reversed
    mixed = less("", [0.1, 0.3] * 5, high)
    assert not mixed.holds
    assert not mixed.is_reversed
    assert mostly("", [True] * 10).holds
    assert mostly("", [False] * 10).is_reversed
    assert always("", [True] * 10).holds
    assert not always("", [True] * 9 + [False]).holds
    assert not always("", [True] * 9 + [False]).is_reversed
    assert always("", [False] * 10).is_reversed


def test_statements___of_several_parts___need_all_or_one() -> None:
    assert all_of("", [HOLDS, HOLDS]).holds
    assert not all_of("", [HOLDS, OPEN]).holds
    assert all_of("", [HOLDS, REVERSED]).is_reversed
    assert any_of("", [HOLDS, REVERSED]).holds
    assert not any_of("", [OPEN, REVERSED]).is_reversed
    assert any_of("", [REVERSED, REVERSED]).is_reversed


def test_ranked___order_of_many___is_told() -> None:
    thesis = np.arange(1.0, 9.0)
    assert ranked("", thesis, thesis**2).holds
    assert ranked("", thesis, thesis[::-1]).is_reversed
    assert not ranked("", thesis, np.ones(8)).holds


def test_pages___agreement_and_same_conclusions___keep_the_rules() -> None:
    rows = re.findall(r"^\| \[\S+\]\(\S+#\S+\) \|(.*)\|$", INDEX.read_text("utf-8"), re.MULTILINE)
    assert rows
    for _, figures, conclusions, verdict in (re.split(r"(?<!\\)\|", row) for row in rows):
        if verdict.strip().endswith("**agrees**"):
            assert "no nearer than a constant" not in figures
        if "same conclusions" in verdict:
            held, _, rest = conclusions.strip().partition(" of ")
            assert held == rest
        if "agrees" in verdict or "same conclusions" in verdict:
            assert "reversed" not in conclusions
