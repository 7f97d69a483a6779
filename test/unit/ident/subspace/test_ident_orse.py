from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IdentificationError, IoData, identify
from flexarm_ident.models.state_space import is_stable
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.methods import METHODS
from flexarm_ident.subspace.orse import innovation_scaled, past_instruments
from support.ident_systems import (
    DT_S,
    arm_model,
    pulse_responses,
    random_model,
    record,
    square_wave,
    step_by_step,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def innovation_deviation(data: IoData, block_rows: int) -> Array:
    """Return the deviation of y_{q-1} given all inputs and earlier outputs, by regression."""
    columns, m = len(data) - block_rows + 1, data.y.shape[1]
    y = [data.y[i : i + columns] for i in range(block_rows)]
    known = np.hstack([*y[:-1], *(data.u[i : i + columns] for i in range(block_rows))])
    residual = y[-1] - known @ np.linalg.lstsq(known, y[-1], rcond=None)[0]
    assert residual.shape[1] == m
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))


def test_innovation_scaled___noisy_data___scale_is_the_regressions_residual() -> None:
    data = record(random_model(7), 900, seed=7, noise=0.1)
    space = innovation_scaled(block_gram([data], 6))
    np.testing.assert_allclose(1.0 / space.output_scale, innovation_deviation(data, 6), rtol=1e-9)


def test_innovation_scaled___unequal_noise___beats_the_plain_scaling() -> None:
    model = random_model(8, states=4, outputs=2, inputs=1)
    errors: dict[str, list[float]] = {"orse": [], "orse_thesis": []}
    for seed in range(5):
        clean = record(model, 4000, seed=seed)
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=clean.y.shape) * clean.y.std(axis=0) * (0.01, 0.8)
        data = replace(clean, y=clean.y + noise)
        for method, collected in errors.items():
            found = identify(data, order=4, block_rows=15, method=method)
            y = step_by_step(found.model, clean.u, found.x0[0])
            collected.append(float(np.linalg.norm(y - clean.y)))
    assert np.mean(errors["orse"]) < 0.8 * np.mean(errors["orse_thesis"])


def test_orse_iv___coloured_noise___beats_orse_without_instruments() -> None:
    model = random_model(11, states=4, outputs=2, inputs=1)
    true = np.sort_complex(np.linalg.eigvals(model.A))
    errors: dict[str, list[float]] = {"orse": [], "orse_iv": []}
    for seed in range(4):
        clean = record(model, 8000, seed=seed)
        white = np.random.default_rng(100 + seed).normal(size=clean.y.shape)
        noise = signal.lfilter([1.0], [1.0, -0.7], white, axis=0)
        noise *= 0.1 * clean.y.std(axis=0) / noise.std(axis=0)
        data = replace(clean, y=clean.y + noise)
        for method, collected in errors.items():
            found = identify(data, order=4, block_rows=15, method=method).model
            missed = np.sort_complex(np.linalg.eigvals(found.A)) - true
            collected.append(float(np.abs(missed).max()))
    assert np.mean(errors["orse_iv"]) < 0.2 * np.mean(errors["orse"])


@pytest.mark.parametrize("method", ["orse", "orse_iv", "orse_thesis"])
@pytest.mark.parametrize("seed", range(3))
def test_identify___noise_free_mimo_data___recovers_the_markov_parameters(
    method: str, seed: int
) -> None:
    model = random_model(seed, states=6)
    data = record(model, 600, seed=seed)
    if METHODS[method].at_rest:
        data = replace(data, y=step_by_step(model, data.u))
    found = identify(data, order=6, block_rows=10, method=method)
    expected = pulse_responses(model)
    np.testing.assert_allclose(
        pulse_responses(found.model), expected, atol=1e-8 * np.abs(expected).max()
    )
    np.testing.assert_allclose(found.fit_error, 0.0, atol=1e-9)


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_matrices___many_seeds_of_the_arm___are_stable_before_any_policy(colour: float) -> None:
    model = arm_model()
    for seed in range(15):
        u = square_wave(2000, seed)
        noise = np.random.default_rng(seed).normal(size=(len(u), 4))
        noise = signal.lfilter([1.0], [1.0, -colour], noise, axis=0)
        y = step_by_step(model, u)
        data = IoData(u, y + 0.02 * y.std(axis=0) * noise, dt_s=DT_S)
        assert is_stable(innovation_scaled(block_gram([data], 40)).matrices(18).A)
        assert is_stable(past_instruments(block_gram([data], 80)).matrices(18).A)


def test_past_instruments___repeated_channel_and_coloured_noise___still_works() -> None:
    model = random_model(12, outputs=2, inputs=1)
    clean = record(model, 3000, seed=12)
    white = np.random.default_rng(12).normal(size=clean.y.shape)
    noise = signal.lfilter([1.0], [1.0, -0.7], white, axis=0)
    y = (clean.y + 0.02 * noise)[:, [0, 1, 1]]
    found = identify(
        replace(clean, y=y, outputs=("a", "b", "c")), order=5, block_rows=12, method="orse_iv"
    )
    expected = pulse_responses(model)[:, [0, 1, 1]]
    assert np.abs(pulse_responses(found.model) - expected).max() < 0.02 * np.abs(expected).max()


def test_innovation_scaled___one_channel_repeats_another___still_works() -> None:
    model = random_model(10, outputs=2, inputs=1)
    data = record(model, 600, seed=10, noise=0.02)
    doubled = replace(data, y=data.y[:, [0, 1, 1]], outputs=("a", "b", "c"))
    found = identify(doubled, order=5, block_rows=10, method="orse")
    assert np.all(found.fit_error < 0.05)


def test_state_matrices___order_beyond_the_block_rows___raises() -> None:
    space = innovation_scaled(block_gram([record(random_model(1), 300, seed=1)], 4))
    assert space.largest_order == 9
    for order in (0, 10):
        with pytest.raises(
            IdentificationError, match=f"order must lie between 1 and 9 .*: {order}"
        ):
            space.matrices(order)
