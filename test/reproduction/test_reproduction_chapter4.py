from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import stats

from flexarm_control.laws.pdpc import Pdpc
from flexarm_daq import RigParameters
from reproduction.chapter4 import ilqr, ilqr_claims, ilqr_designs, pdp, pdpc, pi
from reproduction.framework.findings import SEEDS, Call, spread, thesis_table
from reproduction.framework.rig import StepTrial, step_to, step_trial
from reproduction.framework.verdicts import Judgement, Verdict, less, p_text, sign_test

if TYPE_CHECKING:
    from reproduction.framework.findings import Finding, Subject

SUBJECTS: tuple[Subject, ...] = tuple(
    subject
    for module in (pi, pdp, pdpc, ilqr, ilqr_claims, ilqr_designs)
    for subject in module.SUBJECTS
)
FIGURES = [*range(2, 6), 8, *range(10, 13), *range(15, 19)]
AGREES, PARTLY, DIFFERS = Verdict.AGREES, Verdict.PARTLY, Verdict.DIFFERS
SAME = Verdict.SAME_CONCLUSIONS


def finding_of(key: str, results: dict[Call, Any]) -> Finding:
    (subject,) = (each for each in SUBJECTS if each.key == key)
    return subject.build(results)


def pi_case(**changed: object) -> pi.PiCase:
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
        code: [pi_case(criterion=row["criterion"], kp=row["kp"])] * 20
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
    assert p_text(2e-4) == "p = 0.0002"
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
    cases["Ao2r_9"] = [pi_case(criterion=0.9, kp=0.5)] * 20
    assert pi.table_judgement(cases).verdict is SAME
    cases["Ao2r_9"] = [pi_case(criterion=0.1)] * 20
    assert pi.table_judgement(cases).verdict is DIFFERS


def test_claim_4_1___needs_both_types_to_be_worse_and_has_the_verdict_of_the_figures() -> None:
    def judgement(key: str, other: float) -> Judgement:
        found = {"Ac3r_8": 2.8, "Ac3r_10": 2.8, "Ao2r_9": 2.5, "Ac3r_10c": other}
        results = {
            Call(pi.pi_case, (code, seed)): pi_case(implemented_v=np.full(300, volts))
            for code, volts in found.items()
            for seed in SEEDS
        }
        return finding_of(key, results).judgement

    assert judgement("claim-4-1", 2.4).verdict is AGREES
    assert judgement("claim-4-1", 2.9).verdict is DIFFERS
    assert judgement("figure-4-3", 2.4).verdict is Verdict.ELSEWHERE


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
    assert judge(tuned(far, same), tuned(thesis, same)).verdict is AGREES
    assert judge(tuned(far, same), tuned(thesis, same, 5.0)).verdict is SAME
    assert judge(tuned(thesis, same), tuned(far, apart)).verdict is DIFFERS


def test_figure_4_8___margins_of_the_trial_gains_are_the_recomputed_ones() -> None:
    found = pdp.loop_margins()
    assert [each.gain_db for each in found] == pytest.approx([11.6, 10.7, 9.4], abs=0.1)
    assert [each.phase_deg for each in found] == pytest.approx([69.1, 65.9, 54.3], abs=0.5)
    # By the decibels of the gain the phase is the more sensitive, by its ratio it is not.
    judged = pdp.loop_judgement(found)
    assert judged.verdict is PARTLY
    assert "(gain as a ratio reversed, else it holds): open" in judged.because
    more_sensitive = [each._replace(phase_deg=70.0 - 50.0 * each.payload_kg) for each in found]
    assert pdp.loop_judgement(more_sensitive).verdict is AGREES
    less_sensitive = [each._replace(phase_deg=70.0 - each.payload_kg) for each in found]
    assert pdp.loop_judgement(less_sensitive).verdict is DIFFERS
    # The loop that is plotted crosses -180 deg with the gain that the margin says.
    loop = pdp.loop_gain(0.0, np.linspace(0.2, 10.0, 20_000))
    crossing = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0.0) & (loop.real[:-1] < -0.05))
    assert -20.0 * np.log10(np.abs(loop[crossing]).max()) == pytest.approx(11.6, abs=0.1)


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


def test_claim_4_5_and_figure_4_12___are_judged_by_every_step() -> None:
    assert pdpc.payload_judgement([trial()]).verdict is AGREES
    # The thesis says nothing of the overshoot, so it stands beside.
    over = pdpc.payload_judgement([trial(), trial(overshoot=0.2)])
    assert over.verdict is AGREES
    assert "the overshoot at most 20.0%" in over.because
    late = [trial(mean_error_v=-0.2)] * 20
    assert pdpc.payload_judgement(late).verdict is DIFFERS
    assert pdpc.suppression_judgement([(1.0, 0.02)]).verdict is AGREES
    assert pdpc.suppression_judgement([(1.0, 0.5)]).verdict is DIFFERS


@pytest.mark.parametrize(("rival", "verdict"), [(0.02, AGREES), (0.005, DIFFERS)])
def test_claim_4_6___the_condition_has_to_calm_the_arm(rival: float, verdict: Verdict) -> None:
    laws = {"pdpc": 0.01, "pdpc_unconditional": rival, "pdp": 0.01}
    trials = {
        (law, payload_kg): trial(vibration_v=volts)
        for law, volts in laws.items()
        for payload_kg, _ in pdpc.CASES
    }
    results = dict.fromkeys(pdpc.TRIALS, trials)
    assert finding_of("claim-4-6", results).judgement.verdict is verdict


def test_claims_4_2_and_4_3___can_fail() -> None:
    closer, farther = less("", [0.1] * 20, [0.2] * 20), less("", [0.2] * 20, [0.1] * 20)
    assert pdpc.tracking_judgement([0.03] * 20, 0.2, [closer]).verdict is AGREES
    assert pdpc.tracking_judgement([0.03, 0.08], 0.2, [closer]).verdict is PARTLY
    assert pdpc.tracking_judgement([0.03] * 20, 0.2, [farther]).verdict is DIFFERS
    good, half, bad = [1.0] * 10, [0.4] * 10, [0.0] * 10
    judge, louder = pdp.margin_judgement, pdp.LOUDER_DB
    assert judge(dict(zip(louder, (good, half, bad), strict=True))).verdict is AGREES
    assert judge(dict(zip(louder, ([*good[1:], 0.9], half, bad), strict=True))).verdict is PARTLY
    assert judge(dict(zip(louder, (good, bad, half), strict=True))).verdict is DIFFERS


def ilqr_trial(**changed: float) -> ilqr.IlqrTrial:
    values: dict[str, Any] = {
        "overshoot": 0.02,
        "swing_v": 0.04,
        "last_swing_v": 0.03,
        "reversals": 0,
        "error_v": 0.04,
        "pdpc_error_v": 0.02,
        "pdpc_overshoot": 0.03,
        "effort_v": 3.0,
        "effort_swing_v": 0.01,
    }
    return ilqr.IlqrTrial(**values | changed)


HUNTING = {"overshoot": 0.2, "swing_v": 0.4, "reversals": 2, "last_swing_v": 0.3}


def test_figure_4_15___held_by_the_law_of_the_thesis___whatever_ours_does() -> None:
    held, swings = [ilqr_trial(overshoot=0.01)] * 20, [ilqr_trial(swing_v=0.2)] * 20
    over = [ilqr_trial(overshoot=0.2)] * 20
    judge = ilqr.held_judgement
    assert judge(held, over).verdict is AGREES
    assert judge(over, held).verdict is DIFFERS
    assert judge([*held[1:], ilqr_trial(overshoot=0.01, swing_v=0.2)], held).verdict is PARTLY
    assert judge(swings, held).verdict is DIFFERS


def test_figure_4_17___needs_a_law_that_is_held_with_3_v_and_hunts_with_5() -> None:
    held, hunts = [ilqr_trial()] * 20, [ilqr_trial(**HUNTING)] * 20
    dies = [ilqr_trial(**HUNTING | {"last_swing_v": 0.1})] * 20
    judge, none = ilqr.hunting_judgement, "No law of ours shows both."
    assert judge((held, hunts), (held, held)).verdict is AGREES
    assert judge((held, dies), (held, held)).verdict is DIFFERS
    assert judge((held, held), (held, hunts)).verdict is DIFFERS
    both = judge((hunts, hunts), (held, dies))
    assert both.verdict is PARTLY
    assert none in both.because
    assert "hunts with 5 V (3 V reversed, else it holds): open" in both.because
    assert none not in judge((hunts, hunts), (held, hunts)).because


@pytest.mark.parametrize(("setpoint_v", "figure"), [(3.0, "4-15"), (5.0, "4-17")])
def test_figures_4_16_and_4_18___effort___has_the_verdict_of_the_response(
    setpoint_v: float, figure: str
) -> None:
    found = ilqr.effort_judgement(setpoint_v, [ilqr_trial()], [ilqr_trial()])
    assert found.verdict is Verdict.ELSEWHERE
    assert found.because.endswith(f"figure-{figure}.")


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
    ("closer", "calmer", "verdict"),
    [(True, True, AGREES), (True, False, DIFFERS), (False, True, DIFFERS)],
)
def test_claim_4_4___pdpc_has_to_be_better_in_error_and_overshoot(
    *, closer: bool, calmer: bool, verdict: Verdict
) -> None:
    small, large = [0.1] * 20, [0.2] * 20
    some = (
        less("smaller error", *((small, large) if closer else (large, small))),
        less("smaller overshoot", *((small, large) if calmer else (large, small))),
    )
    assert ilqr_claims.rivals_judgement({3.0: some, 5.0: some}).verdict is verdict


def test_claim_4_7___refers_to_the_figures_of_both_steps() -> None:
    results = dict.fromkeys(
        (*ilqr.needs_at(3.0, ilqr_designs.PRINTED), *ilqr.needs_at(5.0, ilqr_designs.PRINTED)),
        ilqr_trial(),
    )
    judgement = finding_of("claim-4-7", results).judgement
    assert judgement.verdict is Verdict.ELSEWHERE
    assert judgement.because.endswith("figure-4-15 and figure-4-17.")


def test_reversals___count_turns_beyond_the_noise() -> None:
    time_s = np.linspace(0.0, 4.0, 4001)
    assert ilqr._reversals(np.sin(2.0 * np.pi * time_s)) == 8
    assert ilqr._reversals(0.02 * np.sin(2.0 * np.pi * time_s)) == 0
    assert ilqr._reversals(time_s) == 0


def test_step___of_a_law___says_what_the_sensors_would_read_without_noise() -> None:
    run = step_to(Pdpc(), 3.0, arm=RigParameters(payload_kg=0.2), seed=1)
    noise_v = run.y - run.true_y
    assert np.std(noise_v, axis=0) == pytest.approx(RigParameters().noise_v, rel=0.1)
    found = step_trial(run)
    assert abs(found.mean_error_v) <= 0.05
    assert found.vibration_v < found.gauge_v
