"""Choice of the order: past samples, one-step errors, their scatter, and the chosen order."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData, identify
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.order import overdispersion
from flexarm_ident.subspace.pbsid import past_length, predictor_space
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Q = 12


def varx_record(seed: int, lags: int, samples: int = 4000) -> IoData:
    """Return a record of which each sample follows from the `lags` before it."""
    rng = np.random.default_rng(seed)
    blocks = 0.25 * rng.normal(size=(lags, 2, 3)) / np.arange(1, lags + 1)[:, None, None]
    u, y = rng.normal(size=(samples, 1)), np.zeros((samples, 2))
    for k in range(samples):
        y[k] = rng.normal(size=2)
        for lag in range(1, min(lags, k) + 1):
            y[k] += blocks[lag - 1] @ np.concatenate([y[k - lag], u[k - lag]])
    return IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("a", "b"))


def noisy_arm(seed: int, samples: int, noise: Array | float = 0.02) -> IoData:
    u = square_wave(samples, seed)
    y = step_by_step(arm_model(), u)
    disturbance = np.random.default_rng(seed).normal(size=y.shape)
    return IoData(u, y + noise * y.std(axis=0) * disturbance, dt_s=DT_S)


@pytest.mark.parametrize("lags", [1, 2, 4])
def test_past_length___data_of_known_memory___is_found(lags: int) -> None:
    found = [past_length(block_gram([varx_record(seed, lags)], Q)) for seed in range(3)]
    assert found == [lags] * 3


@pytest.mark.parametrize("feedthrough", [False, True])
def test_past_length___noisy_data___is_that_of_explicit_regressions(*, feedthrough: bool) -> None:
    data = record(random_model(2, states=4, outputs=2, inputs=1), 1500, seed=3, noise=0.1)
    z = np.hstack([data.y, data.u])
    columns = len(z) - Q + 1
    # The same equations for every length, as the block rows give them.
    right = data.y[Q - 1 :]
    criteria = []
    for past in range(1, Q):
        left = [z[Q - 1 - lag : len(z) - lag] for lag in range(1, past + 1)]
        left += [data.u[Q - 1 :]] if feedthrough else []
        matrix = np.hstack(left)
        missed = right - matrix @ np.linalg.lstsq(matrix, right, rcond=None)[0]
        likelihood = columns * np.linalg.slogdet(missed.T @ missed / columns)[1]
        criteria.append(likelihood + past * 2 * 3 * np.log(columns))
    expected = int(np.argmin(criteria)) + 1
    assert past_length(block_gram([data], Q), feedthrough=feedthrough) == expected


def test_innovation_covariance___other_data___is_that_of_its_one_step_errors() -> None:
    model = random_model(5, states=4, outputs=2, inputs=1)
    first, other = (record(model, 800, seed, noise=0.1) for seed in (1, 2))
    space = predictor_space(block_gram([first], Q))
    z = np.hstack([other.y, other.u]) / space.rms
    windows = np.lib.stride_tricks.sliding_window_view(z, Q - 1, axis=0)[:-1]
    x = windows.transpose(0, 2, 1).reshape(len(windows), -1) @ space.rows(4).T
    errors = other.y[Q - 1 :] - x @ space.innovation(4).C.T
    found = space.innovation_covariance(4, block_gram([other], Q))
    np.testing.assert_allclose(found, errors.T @ errors / len(errors), rtol=1e-6, atol=1e-9)


def test_overdispersion___white_noise___is_about_one() -> None:
    found = []
    for seed in range(10):
        data = noisy_arm(seed, 4000)
        gram = block_gram([data], 20)
        found.append(overdispersion(predictor_space(gram), 9, gram, [data]))
    assert min(found) >= 1.0
    # Of ten segments: the mean of chi-square over its degrees, less below 1 than above.
    assert np.mean(found) < 2.0


def test_overdispersion___bursts___is_the_variance_of_their_power() -> None:
    samples, half = 10_000, 1000
    level = np.where(np.arange(samples) // half % 2, 0.03, 0.01)[:, np.newaxis]
    data = noisy_arm(1, samples, level)
    gram = block_gram([data], 20)
    found = overdispersion(predictor_space(gram), 9, gram, [data])
    # Power 4 in the mean: segments have 0.8 and 7.2 of it in turn, by levels of 1 to 9.
    expected = half * 3.2**2 / (2.0 * 4.0) * 10.0 / 9.0
    assert found == pytest.approx(expected, rel=0.2)


def test_overdispersion___few_samples___is_one() -> None:
    data = noisy_arm(1, 100)
    gram = block_gram([data], 30)
    assert overdispersion(predictor_space(gram), 9, gram, [data]) == 1.0


@pytest.mark.parametrize("seed", range(3))
def test_choose_order___white_noise___finds_the_order_of_the_arm(seed: int) -> None:
    found = identify(noisy_arm(seed, 6000, 0.002), method="orse")
    assert found.order == arm_model().nstates


@pytest.mark.parametrize("seed", range(3))
def test_choose_order___filtered_outputs___counts_the_states_of_the_filter(seed: int) -> None:
    data = record(random_model(seed, states=4), 6000, seed, noise=0.05)
    b, a = signal.butter(2, 50.0, fs=1.0 / DT_S)
    filtered = replace(data, y=signal.lfilter(b, a, data.y, axis=0))
    found = identify(filtered, method="orse_iv")
    # Two for each of the three outputs.
    assert found.order == 4 + 6


def test_choose_order___unstable_models_left_alone___takes_a_stable_order() -> None:
    data = noisy_arm(4, 3000, 0.2)
    found = identify(data, stable=False, method="orse")
    assert found.order in found.stable_orders


def test_choose_order___few_samples_only___gives_an_order() -> None:
    data = record(random_model(1), 80, seed=1, noise=0.1)
    found = identify(data, block_rows=10, method="orse")
    assert 1 <= found.order <= 9
