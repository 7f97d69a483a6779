from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from reproduction.chapter3 import claims
from reproduction.chapter3.claims import CODES, NOISES
from reproduction.chapter3.costs import (
    RIGS,
    drift_calls,
    drift_table,
    full_model_errors,
    left_out_reason,
)
from reproduction.chapter3.examples import (
    EXAMPLES,
    INITIAL,
    LOW,
    THESIS,
    ReductionTrial,
    Stage,
)
from reproduction.chapter3.trial import (
    errors_text,
    means,
    ratio_text,
    ratios,
    reduction_trial,
    trials,
)
from reproduction.framework.findings import Call
from reproduction.framework.verdicts import Verdict
from support.chapter3_trials import NO_STAGES, trial

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from reproduction.framework.verdicts import Judgement

    Levels = Mapping[tuple[str, str], Sequence[float]]
AGREES, PARTLY, DIFFERS = Verdict.AGREES, Verdict.PARTLY, Verdict.DIFFERS
UPDATES = ("updated", "updated_mrmc", "updated_msv")


def claim_trials(
    codes: Sequence[str],
    levels: Callable[[str, int], Levels],
    stages: Mapping[str, Stage] = NO_STAGES,
) -> dict[tuple[str, str], list[ReductionTrial]]:
    return {
        (code, noise): [trial(levels(code, seed), seed, stages) for seed in range(1, 21)]
        for code in codes
        for noise in NOISES
    }


def test_claim_3_1___mrm_has_to_be_better_in_every_case() -> None:
    def verdict(*, lost: int, last: str = "Ac11_18c") -> Verdict:
        def levels(code: str, seed: int) -> Levels:
            msv = 0.2 if code == last and seed <= lost else 0.5
            return {("mrm", "dmv"): [0.3] * 4, ("msv", "dmv"): [msv] * 4}

        return claims.claim_mrm(claim_trials(CODES, levels)).judgement.verdict

    assert verdict(lost=0) is AGREES
    assert verdict(lost=5) is AGREES
    assert verdict(lost=8) is PARTLY
    assert verdict(lost=15) is DIFFERS


def test_claim_3_2___the_update_has_to_be_better() -> None:
    def judgement(after: float, by_c: float) -> Judgement:
        def levels(_code: str, _seed: int) -> Levels:
            reduced = {(way, "dmv"): [0.5] * 4 for way in ("mrm", "msv", "mrmc")}
            by_b = {(name, "dmv"): [after] * 4 for name in UPDATES}
            by_b["updated_msv", "dmv"] = [1.2 * after] * 4
            other = {(f"{name}_c", "dmv"): [by_c] * 4 for name in UPDATES}
            return {(INITIAL, "dmv"): [0.3] * 4, **reduced, **by_b, **other}

        return claims.claim_update(claim_trials(CODES, levels)).judgement

    assert judgement(0.25, 0.4).verdict is AGREES
    # Only where C is updated does it end below the full model.
    assert judgement(0.4, 0.2).verdict is DIFFERS
    assert judgement(0.6, 0.2).verdict is DIFFERS
    assert claims.BETTER_THAN_FULL == ("Ac11_26", "Ac3_21u", "Ao2_19", "Ac11_18c")


def test_claim_3_3___the_stable_one_has_to_be_better() -> None:
    def judgement(unstable: float, seeds_lost: int = 0) -> Judgement:
        def levels(code: str, seed: int) -> Levels:
            bad = 0.4 if seed <= seeds_lost else 0.3
            mean = unstable if code == claims.UNSTABLE else bad
            kinds = ("dmv", "sfv")
            pair = {(stage, kind): [mean] * 4 for stage in ("updated", "level") for kind in kinds}
            return {(INITIAL, "dmv"): [0.1] * 4, ("mrmc", "dmv"): [0.6] * 4, **pair}

        codes = (claims.STABLE, claims.UNSTABLE)
        return claims.claim_unstable(claim_trials(codes, levels)).judgement

    assert judgement(0.35).verdict is AGREES
    assert judgement(0.35, seeds_lost=8).verdict is PARTLY
    assert judgement(0.25).verdict is DIFFERS
    assert "reduced to 10 states" in judgement(0.25).because
    assert "0.300 in the position when it comes from the stable one and 0.250 from the" in (
        judgement(0.25).because
    )
    assert "in significantly more records in 0 of 4 comparisons" in judgement(0.25).because
    # The update made nothing better.
    assert judgement(0.7).verdict is DIFFERS
    assert "in significantly more records in 4 of 4 comparisons" in judgement(0.7).because


def kept_stage(kept: Sequence[str], bending: int) -> Stage:
    return Stage(10, tuple(kept), (9.0, 23.0, 46.0)[:bending], (0.3,) * 4)


def test_claim_3_4___both_kinds_have_to_be_kept() -> None:
    both, rigid, flexible = (
        kept_stage(("1/2", "3/4", "5/6", "7", "8"), 3),
        kept_stage(("3/4", "7", "8"), 1),
        kept_stage(("1/2", "3/4", "5/6", "7"), 3),
    )

    def verdict(mrmc: Stage) -> Verdict:
        stages = {"mrm": rigid, "msv": flexible, "mrmc": mrmc}
        found = claim_trials(CODES, lambda _code, _seed: {}, stages=stages)
        return claims.claim_mrmc(found).judgement.verdict

    assert verdict(both) is Verdict.BY_CONSTRUCTION
    assert verdict(rigid) is DIFFERS
    assert verdict(flexible) is DIFFERS
    some = claim_trials(CODES, lambda _code, _seed: {}, stages=dict.fromkeys(("mrm", "msv"), rigid))
    for each in some.values():
        each[:] = [replace(one, stages={**one.stages, "mrmc": both}) for one in each]
    some["Ac3_18", LOW][0] = replace(
        some["Ac3_18", LOW][0], stages={**some["Ac3_18", LOW][0].stages, "mrmc": flexible}
    )
    assert claims.claim_mrmc(some).judgement.verdict is DIFFERS


def test_errors___of_trials() -> None:
    found = [
        trial({(INITIAL, "dmv"): [0.1, 0.2, 0.3, 0.4], ("mrm", "dmv"): [0.5] * 4}),
        trial({(INITIAL, "dmv"): [0.5] * 4, ("mrm", "dmv"): [np.inf] * 4}),
    ]
    assert means(found, INITIAL) == pytest.approx([0.25, 0.5])
    assert ratios(found, "mrm") == pytest.approx([2.0, np.inf])
    assert errors_text(np.array([0.1, 0.2, np.inf])) == "0.200 (0.100 to runs away)"


def test_ratios___leave_out_records_whose_full_model_runs_away() -> None:
    found = [
        trial({(INITIAL, "sfv"): [full] * 4, ("updated", "sfv"): [after] * 4})
        for full, after in ((0.5, 1.0), (np.inf, np.inf), (40.0, 1.0))
    ]
    assert ratios(found, "updated", "sfv") == pytest.approx([2.0])
    assert ratios(found[1:], "updated", "sfv") == pytest.approx([np.inf])
    assert ratio_text(np.array([1.0, 2.0, np.inf])) == "2.00"
    assert ratio_text(np.array([np.inf])) == "runs away"


def test_trial___of_the_smallest_example() -> None:
    found = reduction_trial("Ao10_12", LOW, 1)
    assert found.order == 12
    assert sum(len(each.states) for each in found.modes) == 12
    updated = found.stages["updated"]
    labels = {each.label: len(each.states) for each in found.modes}
    assert sum(labels[label] for label in updated.kept) == updated.order
    assert updated.order in (9, 10)
    assert found.realisation_difference < 1e-6
    A, B, C = found.models["updated"]
    assert (A.shape, B.shape, C.shape) == (
        (updated.order,) * 2,
        (updated.order, 1),
        (4, updated.order),
    )
    assert np.abs(np.linalg.eigvals(A)).max() < 1.0
    # Signals are kept of records with the thesis's noise only.
    assert found.curves is None


def test_trial___of_the_unstable_example___has_one_real_eigenvalue_outside() -> None:
    found = reduction_trial("Ac3_21u", THESIS, EXAMPLES["Ac3_21u"].shown_seed)
    (moved,) = found.moved
    assert moved.imag == 0.0
    assert moved.real > 1.0
    A, _, _ = found.models["unstable"]
    assert np.abs(np.linalg.eigvals(A)).max() == pytest.approx(moved.real)
    assert np.abs(np.linalg.eigvals(found.models[INITIAL][0])).max() < 1.0
    assert found.curves is not None
    assert found.curves.measured.shape == found.curves.dmv["unstable"].shape


@pytest.mark.exhaustive
def test_drift___is_less_without_friction_gear_play_and_noise() -> None:
    as_it_is, *_, easiest = (full_model_errors("Ao2_19", rig, 1) for rig in RIGS)
    assert easiest[0] < 0.75 * as_it_is[0]
    results = dict.fromkeys(drift_calls("Ao2_19"), as_it_is)
    table = drift_table("Ao2_19", results)
    assert [row[0] for row in table.rows] == list(RIGS)
    assert table.rows[0][1] == f"{as_it_is[0]:.3f}"


def test_trials___are_looked_up_by_seed() -> None:
    made = {Call(reduction_trial, ("Ac3_18", LOW, seed)): trial({}, seed) for seed in range(1, 21)}
    assert [each.seed for each in trials(made, "Ac3_18", LOW)] == list(range(1, 21))


def test_left_out_rank___is_that_of_the_strongest_missing_mode() -> None:
    made = trial({}, stages={"mrmc": kept_stage(("7", "8", "3/4"), 1)})
    assert made.left_out_rank("mrmc") == 3


@pytest.mark.parametrize(("way", "theirs"), [("msv", 1), ("mrmc", 4)])
def test_left_out_reason___says_ranks_and_what_they_cost(way: str, theirs: int) -> None:
    # Modes of the made-up trial by their rank by MRM: the strongest is "7".
    by_rank = ("7", "8", "1/2", "3/4", "5/6")

    def words(*costs: float) -> str:
        found = [
            trial({(INITIAL, "dmv"): [1.0] * 4}, stages={way: Stage(6, kept, (), (cost,) * 4)})
            for rank, cost in enumerate(costs)
            for kept in (by_rank[:rank],)
        ]
        return left_out_reason("3-1", found, way)

    falling = words(5.0, 4.0, 3.0, 2.0, 1.0)
    assert f"that {way.upper()} leaves out is number {theirs} in the thesis" in falling
    assert "in our records number 3 (1 to 5)" in falling
    assert "what that costs falls with the rank over our records (Spearman -1.00" in falling
    assert "does not fall with" in words(1.0, 2.0, 3.0, 4.0, 5.0)
    assert "the same in all of them" in words(2.0)
