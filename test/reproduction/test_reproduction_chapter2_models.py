from __future__ import annotations

import control
import numpy as np
import pytest

from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.fitting.validation import validate_dmv
from reproduction.chapter2 import (
    easier_rigs,
    order_survey,
    sampling_rates,
    tables,
    validation,
)
from reproduction.chapter2.order_survey import ORDERS
from reproduction.framework.study_rig import STUDY_RIG


def test_orders_text___joins_neighbours() -> None:
    assert tables.orders_text([8, 11, 14, 30, 33, 34]) == "8, 11, 14, 30, 33-34"
    assert tables.orders_text([]) == "none"


def test_candidates___are_the_stable_orders___or_all() -> None:
    stable = np.isin(ORDERS, [10, 12])
    assert order_survey.candidates(stable) == (10, 12)
    assert order_survey.candidates(np.zeros(len(ORDERS), dtype=bool)) == ORDERS


def test_pairs___differ_in_the_rate_alone() -> None:
    for name, other in tables.PAIRS.items():
        low, high = experiment(name), experiment(other)
        assert (low.rate_hz, high.rate_hz) == (300.0, 500.0)
        assert (low.waveform, low.magnitude_v) == (high.waveform, high.magnitude_v)


def test_evened_pairs___are_as_long_and_their_noise_as_dense() -> None:
    for name, other in tables.PAIRS.items():
        slow, (fast, rig) = experiment(name), sampling_rates.evened(other)
        assert fast.samples / fast.rate_hz == pytest.approx(slow.samples / slow.rate_hz)
        for own_v, thesis_v in zip(rig.noise_v, STUDY_RIG.noise_v, strict=True):
            assert own_v**2 / fast.rate_hz == pytest.approx(thesis_v**2 / slow.rate_hz)


def test_least_error___of_a_linear_rig_without_noise___is_next_to_none() -> None:
    def error(*, friction: bool) -> float:
        return easier_rigs.least_error("O_dat2", 1, noise=False, friction=friction)

    assert error(friction=False) < 0.01
    assert error(friction=True) > 0.05


def test_validated_model___of_the_closed_loop___follows_the_set_point() -> None:
    found = validation.validated_model("C_dat2")
    position, simulated = found.set_point[:, 0], found.sfv[:, 0]
    assert np.sqrt(np.mean((position - simulated) ** 2) / np.mean(position**2)) < 0.1


def test_survey___row_of_one_seed___is_that_of_its_models() -> None:
    row = order_survey.survey_once("O_dat1", 1)
    whole = order_survey.thesis_record("O_dat1", 1)
    found = order_survey.identified(order_survey.fitted_half(whole))
    order = int(row["chosen_orders"])
    assert row["stable"][ORDERS.index(order)]
    A = found.subspace.matrices(order).A
    assert np.abs(np.linalg.eigvals(A)).max() < order_survey.CRITICAL_RADIUS
    model, _ = order_survey.model_of(found, order)
    simulated = validate_dmv(model, whole, np.zeros(order)).y
    rms = np.sqrt(np.mean((whole.y - simulated) ** 2, axis=0) / np.mean(whole.y**2, axis=0))
    assert row["chosen_dmv"] == pytest.approx(rms)
    assert order_survey.best_error(whole, whole) == pytest.approx(rms.mean())


def test_loop_is_stable___of_a_lag___until_the_gain_is_too_high() -> None:
    def lag(gain: float) -> control.StateSpace:
        C = [[1.0], [0.0], [0.0], [0.0]]
        return control.ss([[0.9]], [[gain]], C, np.zeros((4, 1)), 1.0 / 300.0)

    # The pole of the loop is at 0.9 - 0.5 gain.
    assert order_survey.loop_is_stable(lag(3.7))
    assert not order_survey.loop_is_stable(lag(3.9))
