from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy import linalg

from flexarm_ident import IdentificationError, IoData, identify
from flexarm_ident.fitting.output_fit import fit_initial_states, fit_inputs, fit_outputs
from flexarm_ident.models import modes
from flexarm_ident.models.state_space import simulate, simulate_states
from support.ident_systems import DT_S, named, pulse_responses, random_model, record, step_by_step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def thesis_regression(
    model: control.StateSpace,
    records: list[IoData],
    *,
    feedthrough: bool,
    level: Array | None = None,
) -> tuple[Array, Array, list[Array]]:
    """Solve (2-14) .. (2-17) with the regressors written out, outputs divided by RMS or level."""
    n, r, m = model.nstates, model.ninputs, model.noutputs
    direct = m * r if feedthrough else 0
    rms = np.sqrt(np.mean([np.mean(d.y**2, axis=0) for d in records], axis=0))
    rms = rms if level is None else level
    rows, targets = [], []
    for number, data in enumerate(records):
        phi = np.zeros((len(data), m, r * n + direct + n * len(records)))
        for j in range(r):
            for i in range(n):
                unit = named(model.A, np.eye(n)[:, [i]], model.C, np.zeros((m, 1)))
                phi[:, :, j * n + i] = step_by_step(unit, data.u[:, [j]])
        for o in range(m if feedthrough else 0):
            phi[:, o, r * n + o * r : r * n + (o + 1) * r] = data.u
        for i in range(n):
            free = step_by_step(model, np.zeros_like(data.u), np.eye(n)[i])
            phi[:, :, r * n + direct + number * n + i] = free
        rows.append((phi / rms[:, np.newaxis]).reshape(-1, phi.shape[2]))
        targets.append((data.y / rms).ravel())
    theta = np.linalg.lstsq(np.vstack(rows), np.concatenate(targets), rcond=None)[0]
    B, D = theta[: r * n].reshape(r, n).T, theta[r * n : r * n + direct].reshape(-1, r)
    return B, D, list(theta[r * n + direct :].reshape(-1, n))


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("schur", [False, True])
def test_fit_inputs___noisy_records___equals_the_thesis_regression(
    *, feedthrough: bool, schur: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if schur:
        monkeypatch.setattr(modes, "_DEFECTIVE_CONDITION", 0.0)
    model = random_model(1, feedthrough=feedthrough)
    records = [record(model, 203, seed=1, noise=0.3), record(model, 64, seed=2, noise=0.3)]
    fit = fit_inputs(model.A, model.C, records, feedthrough=feedthrough)
    B, D, x0 = thesis_regression(model, records, feedthrough=feedthrough)
    np.testing.assert_allclose(fit.B, B, atol=1e-9)
    np.testing.assert_allclose(fit.x0, x0, atol=1e-9)
    if feedthrough:
        np.testing.assert_allclose(fit.D, D, atol=1e-9)
    assert fit.rank == B.size + D.size + 2 * model.nstates


@pytest.mark.parametrize("schur", [False, True])
def test_fit_inputs___at_rest___equals_the_thesis_regression_without_initial_states(
    *, schur: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if schur:
        monkeypatch.setattr(modes, "_DEFECTIVE_CONDITION", 0.0)
    model = random_model(1)
    data = record(model, 203, seed=1, noise=0.3)
    fit = fit_inputs(model.A, model.C, [data], at_rest=True)
    phi = np.stack(
        [
            step_by_step(
                named(model.A, unit[:, np.newaxis], model.C, np.zeros((model.noutputs, 1))),
                data.u[:, [j]],
            )
            for j in range(model.ninputs)
            for unit in np.eye(model.nstates)
        ],
        axis=2,
    )
    theta = np.linalg.lstsq(phi.reshape(-1, phi.shape[2]), data.y.ravel(), rcond=None)[0]
    np.testing.assert_allclose(fit.B, theta.reshape(model.ninputs, -1).T, atol=1e-9)
    np.testing.assert_allclose(fit.x0, 0.0, atol=0.0)


def test_fit_inputs___noise_free_records___exact_with_zero_error() -> None:
    model = random_model(2)
    records = [record(model, 400, seed=3), record(model, 31, seed=4)]
    fit = fit_inputs(model.A, model.C, records)
    np.testing.assert_allclose(fit.B, model.B, atol=1e-10)
    np.testing.assert_allclose(fit.error, 0.0, atol=1e-12)
    rng = np.random.default_rng(4)
    rng.normal(size=(31, model.ninputs))
    np.testing.assert_allclose(fit.x0[1], rng.normal(size=model.nstates), atol=1e-10)


def jordan_model(gap: float) -> control.StateSpace:
    """Return a model with two Jordan blocks, whose eigenvalues are then `gap` apart."""
    triple = 0.9 * np.eye(3) + np.diag([1.0, 1.0], 1) + gap * np.diag([0.0, 1.0, 2.0])
    rotation = 0.95 * np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    pair = np.block([[rotation, np.eye(2)], [np.zeros((2, 2)), rotation + gap * np.eye(2)]])
    A = linalg.block_diag(triple, pair)
    T = np.linalg.qr(np.random.default_rng(0).normal(size=A.shape))[0]
    B = np.random.default_rng(1).normal(size=(7, 2))
    C = np.random.default_rng(2).normal(size=(3, 7))
    return named(T @ A @ T.T, T @ B, C @ T.T, np.zeros((3, 2)))


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-8, 1e-5, 1e-3])
def test_fit_inputs___jordan_blocks___equals_the_thesis_regression(gap: float) -> None:
    model = jordan_model(gap)
    records = [record(model, 1500, seed=5, noise=0.1), record(model, 70, seed=6, noise=0.1)]
    fit = fit_inputs(model.A, model.C, records)
    B, _, x0 = thesis_regression(model, records, feedthrough=False)
    np.testing.assert_allclose(fit.B, B, atol=1e-7)
    np.testing.assert_allclose(fit.x0, x0, atol=1e-7 * np.abs(x0).max())
    assert fit.rank == 7 * 4
    missed = [
        step_by_step(named(model.A, fit.B, model.C, model.D), d.u, start) - d.y
        for d, start in zip(records, fit.x0, strict=True)
    ]
    power = np.sum([np.sum(d.y**2, axis=0) for d in records], axis=0)
    expected = np.sqrt(np.sum([np.sum(each**2, axis=0) for each in missed], axis=0) / power)
    np.testing.assert_allclose(fit.error, expected, rtol=1e-6)


def test_fit_inputs___noise_free_jordan_blocks___exact() -> None:
    model = jordan_model(0.0)
    fit = fit_inputs(model.A, model.C, [record(model, 800, seed=7)])
    np.testing.assert_allclose(fit.B, model.B, atol=1e-9)
    np.testing.assert_allclose(fit.error, 0.0, atol=1e-12)
    assert 1.0 < fit.condition < 1e6


def test_identify___repeated_poles___are_recovered() -> None:
    model = jordan_model(0.0)
    found = identify(record(model, 2000, seed=8), order=7, block_rows=12, method="orse")
    expected = pulse_responses(model)
    np.testing.assert_allclose(
        pulse_responses(found.model), expected, atol=1e-7 * np.abs(expected).max()
    )
    assert fit_inputs(found.model.A, found.model.C, found.records).rank == 7 * 3


@pytest.mark.parametrize("schur", [False, True])
def test_fit_inputs___noise_weighted___is_the_regression_weighted_by_its_own_residual(
    *, schur: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if schur:
        monkeypatch.setattr(modes, "_DEFECTIVE_CONDITION", 0.0)
    model = random_model(9, feedthrough=True)
    records = [record(model, 300, seed=9), record(model, 200, seed=10)]
    rng = np.random.default_rng(11)
    records = [
        replace(d, y=d.y + np.array([0.001, 0.1, 2.0]) * rng.normal(size=d.y.shape))
        for d in records
    ]
    B, D, x0 = thesis_regression(model, records, feedthrough=True)
    first = named(model.A, B, model.C, D)
    left = [
        np.mean((step_by_step(first, d.u, start) - d.y) ** 2, axis=0)
        for d, start in zip(records, x0, strict=True)
    ]
    level = np.sqrt(np.mean(left, axis=0))
    B, D, x0 = thesis_regression(model, records, feedthrough=True, level=level)
    fit = fit_inputs(model.A, model.C, records, feedthrough=True, noise_weighted=True)
    np.testing.assert_allclose(fit.B, B, atol=1e-8)
    np.testing.assert_allclose(fit.D, D, atol=1e-8)
    np.testing.assert_allclose(fit.x0, x0, atol=1e-8)


def test_fit_inputs___noise_weighted___input_matrix_is_closer_to_the_truth() -> None:
    model = random_model(13)
    missed: dict[bool, list[float]] = {False: [], True: []}
    for seed in range(6):
        data = record(model, 500, seed=seed)
        noise = np.array([0.0, 0.5, 0.5]) * np.random.default_rng(seed).normal(size=data.y.shape)
        for weighted, collected in missed.items():
            noisy = replace(data, y=data.y + noise)
            fit = fit_inputs(model.A, model.C, [noisy], noise_weighted=weighted)
            assert fit.rank == model.B.size + model.nstates
            collected.append(float(np.linalg.norm(fit.B - model.B)))
    assert np.mean(missed[True]) < 0.75 * np.mean(missed[False])


def test_fit_inputs___unit_of_an_output_changes___input_matrix_does_not() -> None:
    model = random_model(3)
    data = record(model, 500, seed=6, noise=0.3)
    unit = np.array([1.0, 1000.0, 0.001])
    other = IoData(data.u, data.y * unit, dt_s=DT_S, inputs=data.inputs, outputs=data.outputs)
    here = fit_inputs(model.A, model.C, [data])
    there = fit_inputs(model.A, model.C * unit[:, np.newaxis], [other])
    np.testing.assert_allclose(there.B, here.B, atol=1e-9)
    np.testing.assert_allclose(there.error, here.error, rtol=1e-9)


def test_fit_inputs___unobservable_state___lowers_the_rank() -> None:
    model = named(np.diag([0.5, 0.8]), np.ones((2, 1)), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    fit = fit_inputs(model.A, model.C, [record(model, 200, seed=7)])
    assert fit.rank == 2
    np.testing.assert_allclose(fit.B[0], 1.0, atol=1e-10)


def test_fit_inputs___strongly_unstable_matrix___raises() -> None:
    model = random_model(4)
    with pytest.raises(
        IdentificationError, match=r"magnitude 3\.\d+ makes .* overflow .* take a shorter part"
    ):
        fit_inputs(
            model.A * 3.2 / np.abs(np.linalg.eigvals(model.A)).max(),
            model.C,
            [record(model, 300, seed=8)],
        )


def test_fit_outputs___noise_free_record___recovers_the_output_matrix() -> None:
    model = random_model(5)
    data = record(model, 300, seed=9)
    x0 = fit_initial_states(model, [data])
    fit = fit_outputs(model, x0, [data])
    np.testing.assert_allclose(fit.C, model.C, atol=1e-9)
    assert fit.rank == model.nstates
    assert 1.0 <= fit.condition < 100.0


def test_fit_outputs___uncontrollable_state___lowers_the_rank() -> None:
    A, B, C = np.diag([0.5, 0.8]), np.array([[1.0], [0.0]]), np.ones((1, 2))
    model = named(A, B, C, np.zeros((1, 1)))
    data = record(model, 200, seed=14, at_rest=True)
    fit = fit_outputs(model, [np.zeros(2)], [data])
    assert fit.rank == 1
    np.testing.assert_allclose(fit.C[0], [1.0, 0.0], atol=1e-10)


def test_fit_initial_states___record_in_motion___free_response_is_matched() -> None:
    model = random_model(6, feedthrough=True)
    data = record(model, 100, seed=10)
    (x0,) = fit_initial_states(model, [data])
    np.testing.assert_allclose(step_by_step(model, data.u, x0), data.y, atol=1e-10)


@pytest.mark.parametrize("samples", [2, 31, 32, 33, 500])
def test_simulate___any_length___is_that_of_python_control(samples: int) -> None:
    model = random_model(7, feedthrough=True)
    rng = np.random.default_rng(11)
    u, x0 = rng.normal(size=(samples, 2)), rng.normal(size=model.nstates)
    expected = control.forced_response(model, inputs=u.T, initial_state=x0)
    np.testing.assert_allclose(simulate(model, u, x0), expected.outputs.T, atol=1e-11)
    states = simulate_states(model.A, model.B, u, x0)
    np.testing.assert_allclose(states, expected.states.T, atol=1e-11)


def test_simulate___pulse___gives_the_markov_parameters() -> None:
    model = random_model(8, inputs=1, feedthrough=True)
    u = np.zeros((26, 1))
    u[0] = 1.0
    np.testing.assert_allclose(simulate(model, u), pulse_responses(model)[:, :, 0], atol=1e-12)


@pytest.mark.parametrize("schur", [False, True])
def test_fit_inputs___holes___are_simulated_through_and_do_not_count(
    *, schur: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if schur:
        monkeypatch.setattr(modes, "_DEFECTIVE_CONDITION", 0.0)
    model = random_model(3)
    data = record(model, 500, seed=1)
    rng = np.random.default_rng(2)
    y = data.y + 0.05 * data.y.std(axis=0) * rng.normal(size=data.y.shape)
    for start in (40, 130, 200, 333):
        y[start : start + int(rng.integers(4, 50))] = np.nan
    damaged = replace(data, y=y)
    # What is in the holes must not matter at all.
    other = replace(damaged, y=np.where(damaged.usable[:, np.newaxis], damaged.y, 1e3))
    fit, same = (fit_inputs(model.A, model.C, [each]) for each in (damaged, other))
    np.testing.assert_allclose(fit.B, same.B, rtol=1e-9)
    # The truth is better than the fit nowhere but in the noise.
    np.testing.assert_allclose(fit.B, model.B, atol=0.2 * np.abs(model.B).max())
    fitted = named(model.A, fit.B, model.C, np.zeros((model.noutputs, model.ninputs)))
    missed = (y - step_by_step(fitted, data.u, fit.x0[0]))[damaged.usable]
    power = np.linalg.norm(damaged.y[damaged.usable], axis=0)
    np.testing.assert_allclose(fit.error, np.linalg.norm(missed, axis=0) / power, rtol=1e-6)
