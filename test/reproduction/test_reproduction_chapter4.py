from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import stats

from flexarm_control.laws.pdpc import Pdpc
from flexarm_daq import RigParameters
from reproduction.chapter4 import ilqr, ilqr_claims, ilqr_designs, pdp, pdpc, pi
from reproduction.framework.findings import (
    Call,
    Judgement,
    Verdict,
    p_text,
    sign_test,
    spread,
    thesis_table,
)
from reproduction.framework.rig import StepTrial, step_to, step_trial

if TYPE_CHECKING:
    from reproduction.framework.findings import Finding, Subject

SUBJECTS: tuple[Subject, ...] = tuple(
    subject
    for module in (pi, pdp, pdpc, ilqr, ilqr_claims, ilqr_designs)
    for subject in module.SUBJECTS
)
FIGURES = [*range(2, 6), 8, *range(10, 13), *range(15, 19)]
AGREES, RANKING, DIFFERS = Verdict.AGREES, Verdict.SAME_RANKING, Verdict.DIFFERS


def finding_of(key: str, results: dict[Call, Any]) -> Finding:
    (subject,) = (each for each in SUBJECTS if each.key == key)
    return subject.build(results)


def pi_case(**changed: float) -> pi.PiCase:
    time_s = np.arange(300) / 300.0
    values: dict[str, Any] = {
        "order": 8,
        "kp": 0.4,
        "ki": 0.02,
        "criterion": 0.4,
        "error_v": 0.0,
        "rise_s": 0.8,
        "time_s": time_s,
        "simulated_v": np.full(300, 3.0),
        "implemented_v": np.full(300, 2.7),
        "uncompensated_v": np.full(300, 2.4),
    }
    return pi.PiCase(**values | changed)


def printed_cases() -> dict[str, list[pi.PiCase]]:
    return {
        code: [pi_case(criterion=row["criterion"], kp=row["kp"])] * 3
        for code, row in thesis_table("table_4_1").items()
    }


def test_subjects___are_the_tables_and_figures_of_chapter_4() -> None:
    keys = [subject.key for subject in SUBJECTS]
    assert sorted(keys) == sorted(
        ["table-4-1", "table-4-2"]
        + [f"figure-4-{number}" for number in FIGURES]
        + [f"claim-4-{number}" for number in range(1, 8)]
        + ["choice-4-1"]
    )


def test_sign_test___wins___have_the_probability_of_coins() -> None:
    wins = [0.0] * 9 + [1.0]
    expected = stats.binom.sf(8, 10, 0.5)
    assert sign_test(wins, [0.5] * 10) == pytest.approx(expected)
    assert sign_test([0.5] * 10, [0.5] * 10) == pytest.approx(1.0)


def test_texts___of_evidence() -> None:
    assert p_text(0.0123) == "p = 0.012"
    assert p_text(1e-9) == "p < 0.0001"
    assert spread([3.0, 1.0, 2.0], ".1f") == "2.0 (1.0 to 3.0)"


def test_thesis_table_4_1___type_ii_has_the_least_j() -> None:
    printed = thesis_table("table_4_1")
    assert min(printed, key=lambda code: printed[code]["criterion"]) in ("Ac3r_8", "Ac3r_10")
    assert {code: row["type"] for code, row in printed.items()} == {
        "Ao2r_9": "I",
        "Ac3r_8": "II",
        "Ac3r_10": "II",
        "Ac3r_10c": "III",
    }


def test_table_4_1___is_judged_by_j_and_kp() -> None:
    cases = printed_cases()
    assert pi.table_judgement(cases).verdict is AGREES
    cases["Ao2r_9"] = [pi_case(criterion=0.9, kp=0.5)] * 3
    judgement = pi.table_judgement(cases)
    assert judgement.verdict is RANKING
    assert "kp of Ao2r_9 0.42" in judgement.because
    cases["Ao2r_9"] = [pi_case(criterion=0.1)] * 3
    assert pi.table_judgement(cases).verdict is DIFFERS


@pytest.mark.parametrize(
    ("code", "mismatch", "verdict"),
    [
        ("Ac3r_8", 0.04, AGREES),
        ("Ac3r_8", 0.1, RANKING),
        ("Ac3r_8", 0.3, DIFFERS),
        ("Ao2r_9", 0.2, AGREES),
        ("Ao2r_9", 0.01, DIFFERS),
    ],
)
def test_figures_4_2_to_4_5___type_ii_has_to_follow(
    code: str, mismatch: float, verdict: Verdict
) -> None:
    others = {"Ac3r_10": 0.05, "Ac3r_10c": 0.25, "Ao2r_9": 0.2, "Ac3r_8": 0.05}
    del others[code]
    assert pi.figure_judgement(code, mismatch, others).verdict is verdict


def test_claim_4_1___needs_both_types_to_be_worse() -> None:
    assert pi.claim_judgement({"Ao2r_9": 0.01, "Ac3r_10c": 0.02}).verdict is AGREES
    assert pi.claim_judgement({"Ao2r_9": 0.01, "Ac3r_10c": 0.2}).verdict is DIFFERS


def test_mismatch___is_the_distance_over_the_set_point() -> None:
    case = pi_case()
    assert case.mismatch == pytest.approx(0.1)
    assert case.uncompensated_mismatch == pytest.approx(0.2)
    assert case.implemented_itae == pytest.approx(0.1 * 0.5, rel=0.01)


def test_model_of_type_ii___follows_the_rig() -> None:
    case = pi.pi_case("Ac3r_8", 1)
    assert case.order == 8
    assert case.mismatch < 0.1
    assert np.ptp(case.implemented_v[-300:]) < 0.1


def tuned(
    gains: tuple[float, float, float], criteria: tuple[float, ...], strain_sum: float = 2.407
) -> pdp.Tuned:
    return pdp.Tuned(gains, min(criteria), 1.239, strain_sum, (10.0,), (55.0,), (), criteria)


def test_table_4_2___one_optimum_close_to_the_printed_gains() -> None:
    thesis, far = (0.5935, 4.2664, 0.2538), (0.49, 4.33, 0.005)
    same, apart = (3.5, 3.5, 3.5), (3.5, 3.6, 3.5)
    judge = pdp.tuning_judgement
    assert judge(tuned(thesis, same), tuned(far, same)).verdict is AGREES
    assert judge(tuned(thesis, same, 5.0), tuned(thesis, same)).verdict is RANKING
    assert judge(tuned(far, same), tuned(thesis, same)).verdict is RANKING
    assert judge(tuned(far, same), tuned((0.5, 4.2, 0.1), same)).verdict is DIFFERS
    assert judge(tuned(far, apart), tuned(thesis, same)).verdict is DIFFERS


def test_figure_4_8___margins_of_the_trial_gains_are_the_recomputed_ones() -> None:
    found = pdp.loop_margins()
    assert [gain_db for _, gain_db, _ in found] == pytest.approx([11.2, 10.1, 8.7], abs=0.1)
    assert [phase_deg for *_, phase_deg in found] == pytest.approx([69.9, 67.3, 56.2], abs=0.5)
    assert pdp.loop_judgement(found).verdict is RANKING
    assert pdp.loop_judgement([(0, 11, 70), (1, 10.5, 40)]).verdict is AGREES
    assert pdp.loop_judgement([(0, 11, 70), (1, 12, 40)]).verdict is DIFFERS
    # The loop that is plotted crosses -180 deg with the gain that the margin says.
    loop = pdp.loop_gain(0.0, np.linspace(0.2, 10.0, 20_000))
    crossing = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0.0) & (loop.real[:-1] < -0.05))
    assert -20.0 * np.log10(np.abs(loop[crossing]).max()) == pytest.approx(11.2, abs=0.1)


def test_figure_4_8___has_table_and_two_plots() -> None:
    found = finding_of("figure-4-8", {Call(pdp.loop_margins): pdp.loop_margins()})
    assert len(found.tables[0].rows) == 3
    assert all("<svg" in plot.svg for plot in found.plots)
    assert len(found.plots) == 2


def trial(**changed: float) -> StepTrial:
    values = {
        "mean_error_v": 0.02,
        "overshoot": 0.02,
        "settling_s": 1.0,
        "gauge_v": 0.05,
        "vibration_v": 0.01,
    }
    return StepTrial(**values | changed)


def test_figures_4_10_to_4_12___are_judged_by_their_figures() -> None:
    assert pdpc.calm_judgement({0.0: 0.01, 0.4: 0.01}).verdict is AGREES
    assert pdpc.calm_judgement({0.0: 0.01, 0.4: 0.5}).verdict is RANKING
    assert pdpc.calm_judgement({0.0: 0.5, 0.4: 0.5}).verdict is DIFFERS
    assert pdpc.payload_judgement([trial()]).verdict is AGREES
    assert pdpc.payload_judgement([trial(overshoot=0.2)]).verdict is RANKING
    assert pdpc.payload_judgement([trial(), trial(mean_error_v=-0.2)]).verdict is DIFFERS
    assert pdpc.suppression_judgement([(1.0, 0.02)]).verdict is AGREES
    assert pdpc.suppression_judgement([(1.0, 0.5)]).verdict is RANKING
    assert pdpc.suppression_judgement([(1.0, 1.5)]).verdict is DIFFERS


def test_claims_4_2_and_4_3___can_fail() -> None:
    assert pdpc.tracking_judgement(0.03, 0.2, 0.01).verdict is AGREES
    assert pdpc.tracking_judgement(0.08, 0.2, 0.01).verdict is RANKING
    assert pdpc.tracking_judgement(0.03, 0.2, 0.5).verdict is DIFFERS
    good, half, bad = [1.0] * 10, [0.4] * 10, [0.0] * 10
    judge, louder = pdp.margin_judgement, pdp.LOUDER_DB
    assert judge(dict(zip(louder, (good, half, bad), strict=True))).verdict is AGREES
    assert judge(dict(zip(louder, ([0.9] * 10, half, bad), strict=True))).verdict is RANKING
    assert judge(dict(zip(louder, (good, half, half), strict=True))).verdict is DIFFERS


def ilqr_trial(**changed: float) -> ilqr.IlqrTrial:
    values: dict[str, Any] = {
        "overshoot": 0.02,
        "swing_v": 0.04,
        "last_swing_v": 0.03,
        "reversals": 0,
        "error_v": 0.04,
        "pdpc_error_v": 0.02,
        "pdpc_overshoot": 0.03,
    }
    return ilqr.IlqrTrial(**values | changed)


def test_figures_4_15_to_4_18___held_or_hunting() -> None:
    held, swings, over = [ilqr_trial()], [ilqr_trial(swing_v=0.2)], [ilqr_trial(overshoot=0.2)]
    assert ilqr.held_judgement(held, held).verdict is AGREES
    assert ilqr.held_judgement(held, over).verdict is RANKING
    assert ilqr.held_judgement(held, swings).verdict is RANKING
    assert ilqr.held_judgement(swings, held).verdict is DIFFERS
    assert ilqr.held_judgement(over, held).verdict is DIFFERS
    hunting = {"overshoot": 0.2, "swing_v": 0.4, "reversals": 2}
    dies = ilqr.hunting_judgement([ilqr_trial(**hunting)], [("stiff", "ours")])
    assert dies.verdict is RANKING
    assert "see choice 4-1: stiff (ours)." in dies.because
    assert ilqr.hunting_judgement([ilqr_trial(**hunting, last_swing_v=0.3)], []).verdict is AGREES
    assert ilqr.hunting_judgement([ilqr_trial()], []).verdict is DIFFERS


def test_ilqr___with_the_weights_of_the_thesis___has_its_first_gain() -> None:
    design, printed = ilqr_designs.ilqr_design(ilqr_designs.PRINTED), thesis_table("section_4_4")
    assert abs(design.kc[0]) == pytest.approx(printed["kc"][0], rel=0.1)
    assert design.ki == printed["ki"]
    A, B, C = (np.asarray(getattr(design.model, name)) for name in "ABC")
    for loop in (A - B @ design.kc[np.newaxis], A - design.observer @ C[[0]]):
        assert np.abs(np.linalg.eigvals(loop)).max() < 1.0
    # The first state is the position's, as the thesis noted.
    assert np.argmax(np.abs(C[0])) == 0


def test_variants___of_the_hunting_arm___are_listed() -> None:
    results = dict.fromkeys(ilqr_designs.VARIANT_CALLS, 0.0)
    assert ilqr_designs.hunting_variants(results) == []
    first = next(iter(ilqr_designs.VARIANTS))
    results |= dict.fromkeys(ilqr_designs.VARIANTS[first], 0.5)
    assert ilqr_designs.hunting_variants(results) == [first]
    found = finding_of("choice-4-1", results)
    assert "1 still hunt after 30 s: as it is (ours)." in found.judgement.because


@pytest.mark.parametrize(
    ("errors", "overshoots", "verdict"),
    [
        ({3.0: 0.01, 5.0: 0.5}, {3.0: 0.9, 5.0: 0.01}, AGREES),
        ({3.0: 0.5, 5.0: 0.5}, {3.0: 0.9, 5.0: 0.01}, RANKING),
        ({3.0: 0.5, 5.0: 0.5}, {3.0: 0.9, 5.0: 0.9}, DIFFERS),
    ],
)
def test_claim_4_4___pdpc_has_to_be_better(
    errors: dict[float, float], overshoots: dict[float, float], verdict: Verdict
) -> None:
    found = ilqr_claims.rivals_judgement(errors, overshoots)
    assert found.verdict is verdict
    assert "5 V: " in found.because
    assert "3 V: not the smaller error" in found.because or errors[3.0] < 0.05


@pytest.mark.parametrize(
    ("held", "hunts", "verdict"),
    [
        (AGREES, AGREES, AGREES),
        (AGREES, RANKING, RANKING),
        (RANKING, AGREES, RANKING),
        (AGREES, DIFFERS, DIFFERS),
        (DIFFERS, AGREES, DIFFERS),
    ],
)
def test_claim_4_7___needs_both_steps(held: Verdict, hunts: Verdict, verdict: Verdict) -> None:
    found = ilqr_claims.disturbance_judgement(
        Judgement(held, "It stands."), Judgement(hunts, "It swings.")
    )
    assert found.verdict is verdict
    assert "3 V: It stands. 5 V: It swings." in found.because


def test_reversals___count_turns_beyond_the_noise() -> None:
    time_s = np.linspace(0.0, 4.0, 4001)
    assert ilqr._reversals(np.sin(2.0 * np.pi * time_s)) == 8
    assert ilqr._reversals(0.02 * np.sin(2.0 * np.pi * time_s)) == 0
    assert ilqr._reversals(time_s) == 0


def test_step___of_a_law___tells_what_the_sensors_would_read_without_noise() -> None:
    run = step_to(Pdpc(), 3.0, arm=RigParameters(payload_kg=0.2), seed=1)
    noise_v = run.y - run.true_y
    assert np.std(noise_v, axis=0) == pytest.approx(RigParameters().noise_v, rel=0.1)
    found = step_trial(run)
    assert abs(found.mean_error_v) <= 0.05
    assert found.vibration_v < found.gauge_v
