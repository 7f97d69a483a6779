"""Rules of the verdicts, and the pages that they made."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reproduction.framework.verdicts import (
    Beside,
    Judgement,
    Statement,
    Verdict,
    all_of,
    always,
    exactly,
    judged,
    less,
    mostly,
    ranked,
    sign_test,
)
from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Sequence

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
    if statements:
        held = statements.count(HOLDS)
        assert f"Conclusions, {held} of {len(statements)}: " in found.because


POSITIVE = st.floats(1e-3, 1e3)


@given(st.lists(POSITIVE, min_size=1, max_size=20), POSITIVE, st.data())
def test_constant___beside_any_figures___never_agrees(
    theirs: list[float], anywhere: float, data: st.DataObject
) -> None:
    for constant in (anywhere, data.draw(st.sampled_from(theirs)), float(np.median(theirs))):
        levelled = Beside("errors", tuple(theirs), (constant,) * len(theirs))
        for statements in ([], [HOLDS]):
            found = judged(figures=[levelled], statements=statements)
            assert found.verdict is not Verdict.AGREES


RUNS = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=5, max_size=30)


@given(st.lists(RUNS, min_size=1, max_size=4), st.booleans())
def test_reversed_statement___among_any_others___is_neither_agreement_nor_same_conclusions(
    runs: list[list[tuple[int, int]]],
    near: bool,  # noqa: FBT001 - drawn
) -> None:
    reported = [less("told", *zip(*pairs, strict=True)) for pairs in runs]
    turned = [less("turned", *tuple(zip(*pairs, strict=True))[::-1]) for pairs in runs]
    # What the runs bear out is reversed where the thesis says the opposite.
    assert [each.holds for each in reported] == [each.is_reversed for each in turned]
    found = judged(figures=[NEAR] if near else [FAR], statements=turned)
    if any(each.holds for each in reported):
        assert found.verdict is Verdict.DIFFERS


@pytest.mark.parametrize(
    ("within", "number", "near"), [(9, 10, True), (8, 10, False), (4, 4, True), (3, 4, False)]
)
def test_beside___most_within_the_band___are_nine_in_ten_or_all_of_fewer(
    within: int,
    number: int,
    near: bool,  # noqa: FBT001 - as the table has it
) -> None:
    ours = (1.0,) * within + (9.0,) * (number - within)
    assert Beside("errors", (1.0,) * number, ours).is_near is near


def test_beside___band___is_a_factor_of_one_and_a_half_both_ways_with_its_edge() -> None:
    factors = (1.5, 1.49, 1.51, 1.0 / 1.49, 1.0 / 1.51)
    assert Beside("errors", (1.0,) * len(factors), factors).within == 3


@pytest.mark.parametrize(("thesis", "ours"), [((1.0, 2.0), (1.0,)), ((0.0,), (1.0,))])
def test_beside___figures_without_a_ratio___are_refused(
    thesis: tuple[float, ...], ours: tuple[float, ...]
) -> None:
    with pytest.raises(ValueError, match="positive figures in pairs"):
        Beside("errors", thesis, ours)


def test_judged___figures_of_several_kinds___have_to_agree_all() -> None:
    other = Beside("gains", FAR.thesis, FAR.ours)
    found = judged(figures=[NEAR, other], statements=[HOLDS])
    assert found.verdict is Verdict.SAME_CONCLUSIONS
    for each in (NEAR, other):
        assert each.text in found.because
    assert judged(figures=[NEAR, other]).verdict is Verdict.PARTLY


def test_judged___by_construction___is_reported_of_an_agreement_only() -> None:
    def verdict(*statements: Statement, figures: Sequence[Beside] = ()) -> Verdict:
        return judged(figures=figures, statements=statements, by_construction=True).verdict

    assert verdict(HOLDS) is Verdict.BY_CONSTRUCTION
    assert verdict(HOLDS, figures=[FAR]) is Verdict.SAME_CONCLUSIONS
    assert verdict(HOLDS, OPEN) is Verdict.PARTLY
    assert verdict(HOLDS, REVERSED) is Verdict.DIFFERS


def test_judged___without_parts___is_refused() -> None:
    with pytest.raises(ValueError, match="cannot be judged"):
        judged(evidence="Nothing.")
    with pytest.raises(ValueError, match="what it rests on"):
        Judgement(Verdict.DIFFERS, " ")


def test_beside___distances___are_those_of_a_calculation_by_hand() -> None:
    # Off by the factors 2, 1 and 4; the best constant is 2, off by 2, 1 and 2.
    found = Beside("errors", (1.0, 2.0, 4.0), (2.0, 2.0, 1.0))
    assert found.within == 1
    assert found.distance == pytest.approx(2.0)
    assert found.constant_distance == pytest.approx(2.0 ** (2.0 / 3.0))
    assert not found.agrees
    # The best constant is 1, off by 1, 1 and 8; ours are off by as much, and so no nearer.
    level = Beside("errors", (1.0, 1.0, 8.0), (1.0, 1.0, 64.0))
    assert level.distance == pytest.approx(2.0)
    assert level.constant_distance == pytest.approx(2.0)
    assert not level.beats_constant
    # As far off as the constant 0.5, figure by figure, but for the rounding.
    assert not Beside("errors", (0.2, 0.8, 0.5), (0.08, 1.28, 0.5)).beats_constant


def test_beside___runaway___is_no_agreement() -> None:
    found = Beside("errors", THESIS, (0.1, 0.2, 0.4, float("inf")))
    assert found.within == 3
    assert not found.agrees
    assert "no number (one is missing)" in found.text


@pytest.mark.parametrize(
    ("p_value", "p_opposite", "outcome"),
    [(0.049, 1.0, "holds"), (0.05, 1.0, "open"), (1.0, 0.05, "open"), (1.0, 0.049, "reversed")],
)
def test_statement___at_the_level___is_open(
    p_value: float, p_opposite: float, outcome: str
) -> None:
    assert Statement("", p_value, p_opposite).outcome == outcome


@pytest.mark.parametrize(("holds", "outcome"), [(True, "holds"), (False, "reversed")])
def test_exactly___without_scatter___holds_or_is_reversed(
    holds: bool,  # noqa: FBT001 - as the table has it
    outcome: str,
) -> None:
    assert exactly("told", holds=holds).text == f"told: {outcome}"


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


@pytest.mark.parametrize(
    ("parts", "outcome"),
    [
        ((HOLDS, HOLDS), "holds"),
        ((HOLDS, OPEN), "open"),
        # One for and one against is not a case for the opposite.
        ((HOLDS, REVERSED), "open"),
        ((OPEN, OPEN), "open"),
        ((OPEN, REVERSED), "reversed"),
        ((REVERSED, REVERSED), "reversed"),
    ],
)
def test_statement___of_several_parts___holds_stays_open_or_is_reversed(
    parts: tuple[Statement, ...], outcome: str
) -> None:
    assert all_of("all", parts).outcome == outcome


def test_statement___of_parts_that_differ___says_each_of_them() -> None:
    assert all_of("all", [HOLDS, REVERSED]).text == "all (c reversed, else it holds): open"
    assert all_of("all", [OPEN, REVERSED]).text == "all (b open, c reversed): reversed (p = 0.02)"
    assert all_of("all", [HOLDS, HOLDS]).text == "all: holds (p = 0.01)"


def test_statement___that_is_reversed___says_how_likely_chance_reverses_it() -> None:
    assert Statement("told", 0.99, 0.02).text == "told: reversed (p = 0.02)"
    assert Statement("told", 0.3, 0.8).text == "told: open (p = 0.3)"
    assert Statement("told", 1.0, 0.0).text == "told: reversed"


def test_sign_test___ties___count_against_the_claim() -> None:
    # At least one of three fair coins.
    assert sign_test([0, 1, 1], [1, 1, 1]) == pytest.approx(1.0 - 0.5**3)
    assert sign_test([1, 1, 1], [1, 1, 1]) == pytest.approx(1.0)
    assert sign_test([0] * 5, [1] * 5) == pytest.approx(0.5**5)
    with pytest.raises(ValueError, match="shorter"):
        sign_test([0, 1], [1])
    ties = less("", [0] * 5 + [1] * 5, [1] * 10)
    assert not ties.holds
    assert not ties.is_reversed


def test_statements___of_several_parts___are_tested_as_several() -> None:
    # One of two parts may be what chance gives one in twenty times.
    once, twice = Statement("", 0.9, 0.03), Statement("", 0.9, 0.02)
    other = Statement("", 0.9, 0.9)
    assert all_of("", [once, other]).p_opposite == pytest.approx(0.06)
    assert all_of("", [twice, other]).is_reversed
    assert all_of("", [other, other]).p_opposite == pytest.approx(1.0)
    assert all_of("", [Statement("", 0.9, 0.6)] * 2).p_opposite == pytest.approx(1.0)


def test_ranked___order_of_many___is_reported() -> None:
    thesis = np.arange(1.0, 9.0)
    assert ranked("", thesis, thesis**2).holds
    assert ranked("", thesis, thesis[::-1]).is_reversed
    assert ranked("", thesis, np.ones(8)).p_value == pytest.approx(1.0)
    # One-sided: what is not evidence for one order is as much evidence for the other.
    mixed = ranked("", thesis, [2, 1, 4, 3, 6, 5, 8, 7])
    assert mixed.p_value + mixed.p_opposite == pytest.approx(1.0)


def test_pages___see_elsewhere___leads_to_subjects_with_a_verdict_of_their_own() -> None:
    index = INDEX.read_text("utf-8")
    verdicts = dict(re.findall(r"^\| \[(\S+)\]\(.*\*\*(.+)\*\* \|$", index, re.MULTILINE))
    elsewhere = Verdict.ELSEWHERE.value
    reported = set()
    for page in sorted(INDEX.parent.glob("*.md")):
        sections = re.split(r'^<a id="(\S+)"></a>$', page.read_text("utf-8"), flags=re.MULTILINE)
        for key, section in zip(sections[1::2], sections[2::2], strict=True):
            _, is_elsewhere, words = section.partition(f"**{elsewhere}**: ")
            if is_elsewhere:
                reported.add(key)
                named = re.findall(r"(?:table|figure|claim|appendix)-\S*\w", words.splitlines()[0])
                assert named, key
                assert [verdicts[each] for each in named if verdicts[each] == elsewhere] == [], key
    assert reported == {key for key, verdict in verdicts.items() if verdict == elsewhere}


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
