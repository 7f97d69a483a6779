from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import signal, stats

from flexarm_ident import IoData, preprocess, read_bag
from flexarm_ident.subspace.feedback import feedback_test
from flexarm_ident.subspace.gram import block_gram
from support.ident_systems import DT_S, arm_model, square_wave, step_by_step
from support.project import BAGS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def open_loop(seed: int, *, colour: str = "white", samples: int = 3000) -> IoData:
    rng = np.random.default_rng(seed)
    u = square_wave(samples, seed)
    y = step_by_step(arm_model(), u)
    noise = rng.normal(size=y.shape)
    if colour == "ar":
        noise = signal.lfilter([1.0], [1.0, -0.9], noise, axis=0)
    if colour == "butterworth":
        noise = signal.lfilter(*signal.butter(2, 50.0, fs=300.0), noise, axis=0)
    return IoData(u, y + 0.02 * y.std(axis=0) * noise, dt_s=DT_S)


@pytest.mark.slow
def test_feedback_test___open_loop___p_values_are_those_of_chance() -> None:
    tests = [feedback_test([d], block_gram([d], 20)) for d in map(open_loop, range(60))]
    assert {test.degrees for test in tests} == {20}
    # Uniformly distributed: Kolmogorov and Smirnov see nothing odd.
    assert stats.kstest([test.p_value for test in tests], "uniform").pvalue > 1e-3
    assert not any(test.detected for test in tests)


@pytest.mark.parametrize("colour", ["ar", "butterworth"])
def test_feedback_test___coloured_noise_in_open_loop___is_no_feedback(colour: str) -> None:
    for seed in range(8):
        data = open_loop(seed, colour=colour)
        assert not feedback_test([data], block_gram([data], 40)).detected


def test_feedback_test___statistic___is_that_of_the_explicit_regression() -> None:
    data = open_loop(3, samples=900)
    z = np.hstack([data.y, data.u])
    columns = len(z) - 11
    hankel = np.vstack([z[i : i + columns].T for i in range(12)])
    past, rest = hankel[:45], hankel[45:]
    rest = rest - rest @ np.linalg.pinv(past) @ past
    innovation, following = rest[:4], rest[[4, 9, 14]]
    # The squared canonical correlations are the eigenvalues of the product of projections.
    q_e = np.linalg.qr(innovation.T)[0]
    q_u = np.linalg.qr(following.T)[0]
    expected = (columns - 45) * np.sum(np.linalg.svd(q_e.T @ q_u)[1] ** 2)
    found = feedback_test([data], block_gram([data], 12))
    assert found.statistic == pytest.approx(expected, rel=1e-6)
    assert found.degrees == 12


@pytest.mark.parametrize("seed", range(4))
def test_feedback_test___disturbance_of_the_inputs_period___is_no_feedback(seed: int) -> None:
    # Friction does that: it leaves what no linear model explains, again in each period.
    rng = np.random.default_rng(seed)
    u = np.tile(np.repeat([2.0, -2.0], 100), 40)[:, np.newaxis]
    repeated = np.tile(rng.normal(size=(200, 4)), (40, 1))
    y = step_by_step(arm_model(), u)
    y += 0.02 * y.std(axis=0) * (repeated + rng.normal(size=y.shape))
    data = IoData(u, y, dt_s=DT_S)
    found = feedback_test([data], block_gram([data], 40))
    assert found.p_value < 1e-6
    assert not found.detected


@pytest.mark.parametrize("bag", ["c_dat3_0g", "c_dat3_400g", "quanser_2dsfl"])
def test_feedback_test___recorded_closed_loops___are_found(bag: str) -> None:
    data = preprocess(read_bag(BAGS / bag))
    assert feedback_test([data], block_gram([data], 40)).detected


def test_feedback_test___no_noise___is_undecided() -> None:
    u = square_wave(2000, 1)
    data = IoData(u, step_by_step(arm_model(), u), dt_s=DT_S)
    found = feedback_test([data], block_gram([data], 20))
    assert not found.detected
    assert found.degrees == 0
    assert found.p_value == 1.0
