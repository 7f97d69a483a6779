from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexarm_ident import IoData, identify, reduce_model, validate_dmv
from flexarm_ident.models.modes import modal_form, ranked_modes
from flexarm_ident.models.state_space import simulate, stabilise
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.orse import innovation_scaled
from support.exhaustive import wide
from support.ident_systems import (
    arm_model,
    named,
    pulse_responses,
    random_model,
    record,
    square_wave,
    step_by_step,
)

SEEDS = st.integers(0, 10_000)
few = settings(max_examples=wide(8, 25), suppress_health_check=[HealthCheck.too_slow])


@few
@given(SEEDS, st.integers(2, 6), st.integers(1, 3), st.integers(1, 2))
def test_identify___noise_free_random_model___markov_parameters_are_recovered(
    seed: int, states: int, outputs: int, inputs: int
) -> None:
    model = random_model(seed, states, outputs, inputs)
    found = identify(record(model, 500, seed), order=states, block_rows=8, method="orse")
    expected = pulse_responses(model)
    # The weakest mode limits the digits that one record holds.
    weakest = found.singular_values[states - 1] / found.singular_values[0]
    tolerance = 1e-8 * np.abs(expected).max() + 1e-13 / weakest
    np.testing.assert_allclose(pulse_responses(found.model), expected, rtol=0, atol=tolerance)


@few
@given(SEEDS, st.integers(60, 400), st.integers(2, 12))
def test_block_gram___any_record___equals_explicit_hankel_product(
    seed: int, samples: int, block_rows: int
) -> None:
    data = record(random_model(seed), samples, seed)
    z = np.hstack([data.y, data.u])
    columns = samples - block_rows + 1
    explicit = np.vstack([z[i : i + columns].T for i in range(block_rows)])
    gram = block_gram([data], block_rows).matrix
    np.testing.assert_allclose(gram, explicit @ explicit.T, rtol=0, atol=1e-12 * np.abs(gram).max())


@few
@given(SEEDS, st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_identify___outputs_in_other_units___model_changes_by_the_units_only(
    seed: int, exponents: list[float]
) -> None:
    data = record(random_model(seed), 600, seed, noise=0.05)
    unit = 10.0 ** np.array(exponents)
    here = identify(data, order=5, block_rows=8, method="orse")
    there = identify(replace(data, y=data.y * unit), order=5, block_rows=8, method="orse")
    np.testing.assert_allclose(
        pulse_responses(there.model) / unit[:, np.newaxis],
        pulse_responses(here.model),
        atol=1e-6 * np.abs(pulse_responses(here.model)).max(),
    )
    np.testing.assert_allclose(there.fit_error, here.fit_error, rtol=1e-6)


@few
@given(SEEDS)
def test_innovation_scaled___record_split_in_two___products_of_parts_give_the_same_space(
    seed: int,
) -> None:
    model = random_model(seed)
    first, second = record(model, 300, seed, noise=0.1), record(model, 250, seed + 1, noise=0.1)
    ways = [innovation_scaled(block_gram(r, 6)) for r in ([first, second], [second, first])]
    np.testing.assert_allclose(ways[0].singular_values, ways[1].singular_values, rtol=1e-9)


@few
@given(SEEDS)
def test_modes_and_dmv___another_realisation___are_the_same(seed: int) -> None:
    model = random_model(seed)
    data = record(model, 200, seed, noise=0.1)
    T = np.linalg.qr(np.random.default_rng(seed).normal(size=(5, 5)))[0] * 1.7
    other = named(T @ model.A @ T.T / 1.7**2, T @ model.B, model.C @ T.T / 1.7**2, model.D)
    for one, two in zip(
        ranked_modes(model, [data], np.ones(3)),
        ranked_modes(other, [data], np.ones(3)),
        strict=True,
    ):
        np.testing.assert_allclose([two.msv, two.mrm], [one.msv, one.mrm], rtol=1e-8)
        np.testing.assert_allclose(two.eigenvalue, one.eigenvalue, atol=1e-10)
    np.testing.assert_allclose(
        validate_dmv(other, data).delta, validate_dmv(model, data).delta, rtol=1e-8
    )


@few
@given(SEEDS, st.integers(1, 8), st.sampled_from(["mrm", "msv"]), st.booleans())
def test_reduce_model___any_order___pairs_stay_whole(
    seed: int,
    order: int,
    ranking: str,
    update: bool,  # noqa: FBT001 (drawn)
) -> None:
    model = random_model(seed, states=8)
    data = record(model, 400, seed, noise=0.02)
    found = identify(data, order=8, block_rows=10, method="orse")
    reduced = reduce_model(
        found,
        data,
        ranking=ranking,  # type: ignore[arg-type]
        order=order,
        update="b" if update else "none",
    )
    assert order <= reduced.order <= order + 1
    eigenvalues = np.linalg.eigvals(reduced.model.A)
    np.testing.assert_allclose(
        np.sort_complex(eigenvalues), np.sort_complex(eigenvalues.conj()), atol=1e-12
    )
    kept = [state for mode in reduced.modes if mode.kept for state in mode.states]
    full = modal_form(found.model).eigenvalues
    for value in full[kept]:
        assert np.abs(eigenvalues - value).min() < 1e-9


@few
@given(SEEDS, st.floats(0.3, 3.0))
def test_stabilise___any_matrix___stable_with_frequencies_kept(seed: int, radius: float) -> None:
    A = np.random.default_rng(seed).normal(size=(6, 6))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    stable, moved = stabilise(A)
    before, after = np.linalg.eigvals(A), np.linalg.eigvals(stable)
    assert np.abs(after).max() < 1.0
    assert moved == np.sum(np.abs(before) >= 1.0)
    for value in before[np.abs(before) > 1e-3]:
        expected = value if abs(value) < 1.0 else value / abs(value) * min(0.9999, 1 / abs(value))
        assert np.abs(after - expected).min() < 1e-6


@few
@given(SEEDS, st.floats(-5.0, 5.0))
def test_simulate___inputs_and_initial_states___superpose(seed: int, factor: float) -> None:
    model = random_model(seed, feedthrough=True)
    rng = np.random.default_rng(seed)
    u, v = rng.normal(size=(2, 100, 2))
    a, b = rng.normal(size=(2, 5))
    together = simulate(model, u + factor * v, a + factor * b)
    np.testing.assert_allclose(
        together, simulate(model, u, a) + factor * simulate(model, v, b), atol=1e-9
    )


@settings(max_examples=6)
@given(st.integers(0, 1000))
def test_identify___more_data_of_the_arm___never_much_worse(seed: int) -> None:
    model, u = arm_model(), square_wave(8000, seed)
    clean = step_by_step(model, u)
    noise = 0.1 * clean.std(axis=0) * np.random.default_rng(seed).normal(size=clean.shape)
    data = IoData(u, clean + noise, dt_s=float(model.dt))
    errors = []
    for samples in (1500, 8000):
        found = identify(data.head(samples), order=12, block_rows=25, method="orse")
        y = simulate(found.model, u)
        errors.append(np.mean(np.linalg.norm(y - clean, axis=0) / np.linalg.norm(clean, axis=0)))
    assert errors[1] < 1.2 * errors[0] + 0.02
