"""PBSID-opt against known systems, with and without feedback and coloured noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from flexarm_ident import IdentificationError, IoData
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.orse import innovation_scaled
from flexarm_ident.subspace.pbsid import predictor_space
from support.ident_systems import DT_S, pulse_responses, random_model, record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def responses(A: Array, B: Array, C: Array, D: Array, count: int = 25) -> Array:
    x, all_responses = B, [D]
    for _ in range(count):
        all_responses.append(C @ x)
        x = A @ x
    return np.array(all_responses)


@given(seed=st.integers(0, 50), feedthrough=st.booleans(), alone=st.booleans())
@settings(max_examples=30)
def test_predictor___noise_free_records___recovers_pulse_responses(
    *, seed: int, feedthrough: bool, alone: bool
) -> None:
    model = random_model(seed, feedthrough=feedthrough)
    records = [record(model, 700, seed), record(model, 500, seed + 1)]
    gram = block_gram(records, 9)
    space = predictor_space(gram, feedthrough=feedthrough, order=5 if alone else None)
    found = space.innovation(5)
    known = pulse_responses(model)
    scale = np.abs(known).max()
    assert np.abs(responses(found.A, found.B, found.C, found.D) - known).max() < 1e-8 * scale


def test_predictor___innovation_form___recovers_gain_and_covariance() -> None:
    model = random_model(3)
    rng = np.random.default_rng(0)
    K = 0.1 * rng.normal(size=(5, 3))
    K *= 0.9 / max(1.0, np.abs(np.linalg.eigvals(model.A - K @ model.C)).max())
    deviation = np.array([0.5, 1.0, 2.0])
    samples = 60_000
    u, e = rng.normal(size=(samples, 2)), rng.normal(size=(samples, 3)) * deviation
    x, y = np.zeros(5), np.empty((samples, 3))
    for k in range(samples):
        y[k] = model.C @ x + e[k]
        x = model.A @ x + model.B @ u[k] + K @ e[k]
    data = IoData(
        u,
        y,
        dt_s=DT_S,
        inputs=tuple(model.input_labels),
        outputs=tuple(model.output_labels),
    )
    found = predictor_space(block_gram([data], 31)).innovation(5)
    known = responses(model.A, K, model.C, np.eye(3), 10)
    noise = responses(found.A, found.K, found.C, np.eye(3), 10)
    assert np.abs(noise - known).max() < 0.05 * np.abs(known).max()
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(deviation, rel=0.02)


def closed_loop_record(seed: int, samples: int = 6000) -> tuple[Array, Array, Array]:
    """Return input and output of a plant under strong feedback of coloured noise, and its poles."""
    rng = np.random.default_rng(seed)
    pole = 0.95 * np.exp(0.5j)
    poles = np.array([0.995, pole, np.conj(pole)])
    A, B, C, _ = signal.tf2ss([0.1, -0.12, 0.06], np.real(np.poly(poles)))
    noise = signal.lfilter([1.0], [1.0, -0.9], 0.05 * rng.normal(size=samples))
    reference = rng.normal(size=samples)
    x, u, y = np.zeros(3), np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        y[k] = C[0] @ x + noise[k]
        u[k] = 0.5 * (reference[k] - y[k])
        x = A @ x + B[:, 0] * u[k]
    return u, y, poles


def pole_error(A: Array, known: Array) -> float:
    found = np.linalg.eigvals(A)
    return float(sum(np.abs(found - pole).min() for pole in known))


def test_predictor___feedback_and_coloured_noise___beats_orse() -> None:
    pbsid, orse = [], []
    for seed in range(10):
        u, y, poles = closed_loop_record(seed)
        data = IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("y",), closed_loop=True)
        pbsid.append(pole_error(predictor_space(block_gram([data], 21)).innovation(4).A, poles))
        plain = innovation_scaled(block_gram([data], 20)).matrices(4)
        orse.append(pole_error(plain.A, poles))
    assert np.median(pbsid) < 0.5 * np.median(orse)


@pytest.mark.parametrize("order", [0, 25])
def test_predictor___impossible_order___raises(order: int) -> None:
    model = random_model(1)
    space = predictor_space(block_gram([record(model, 500, 1, noise=0.1)], 5))
    with pytest.raises(IdentificationError, match="order must lie between 1 and"):
        space.innovation(order)


def test_predictor___no_past___raises() -> None:
    with pytest.raises(IdentificationError, match="2 or more block rows"):
        predictor_space(block_gram([record(random_model(1), 100, 1)], 1))


@given(seed=st.integers(0, 50), noise=st.sampled_from([1e-9, 1e-3, 0.1]))
@settings(max_examples=15)
def test_predictor___of_one_order___has_the_poles_of_that_of_all(
    *, seed: int, noise: float
) -> None:
    gram = block_gram([record(random_model(seed), 3000, seed, noise=noise)], 30)
    one = predictor_space(gram, order=5).matrices(5)
    every = predictor_space(gram).matrices(5)
    assert pole_error(every.A, np.array(np.linalg.eigvals(one.A))) < 1e-6
