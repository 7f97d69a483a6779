from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from ident_systems import DT_S, named, pulse_responses, random_model, record, step_by_step

from flexarm_ident import IdentificationError, IoData, output_fit
from flexarm_ident.output_fit import fit_initial_states, fit_inputs, fit_outputs
from flexarm_ident.simulation import simulate, simulate_states

if TYPE_CHECKING:
    import control
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def thesis_regression(
    model: control.StateSpace, records: list[IoData], *, feedthrough: bool
) -> tuple[Array, Array, list[Array]]:
    """Solve (2-14) .. (2-17) with the regressors written out, rows weighted by each RMS."""
    n, r, m = model.nstates, model.ninputs, model.noutputs
    direct = m * r if feedthrough else 0
    rms = np.sqrt(np.mean([np.mean(d.y**2, axis=0) for d in records], axis=0))
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
@pytest.mark.parametrize("stepwise", [False, True])
def test_fit_inputs___noisy_records___equals_the_thesis_regression(
    *, feedthrough: bool, stepwise: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if stepwise:
        monkeypatch.setattr(output_fit, "_DEFECTIVE_CONDITION", 0.0)
    model = random_model(1, feedthrough=feedthrough)
    records = [record(model, 203, seed=1, noise=0.3), record(model, 64, seed=2, noise=0.3)]
    fit = fit_inputs(model.A, model.C, records, feedthrough=feedthrough)
    B, D, x0 = thesis_regression(model, records, feedthrough=feedthrough)
    np.testing.assert_allclose(fit.B, B, atol=1e-9)
    np.testing.assert_allclose(fit.x0, x0, atol=1e-9)
    if feedthrough:
        np.testing.assert_allclose(fit.D, D, atol=1e-9)
    assert fit.rank == B.size + D.size + 2 * model.nstates


def test_fit_inputs___noise_free_records___exact_with_zero_error() -> None:
    model = random_model(2)
    records = [record(model, 400, seed=3), record(model, 31, seed=4)]
    fit = fit_inputs(model.A, model.C, records)
    np.testing.assert_allclose(fit.B, model.B, atol=1e-10)
    np.testing.assert_allclose(fit.error, 0.0, atol=1e-12)
    rng = np.random.default_rng(4)
    rng.normal(size=(31, model.ninputs))
    np.testing.assert_allclose(fit.x0[1], rng.normal(size=model.nstates), atol=1e-10)


def test_fit_inputs___defective_state_matrix___is_fitted_step_by_step() -> None:
    A = np.array([[0.9, 1.0, 0.0], [0.0, 0.9, 1.0], [0.0, 0.0, 0.9]])
    model = named(A, np.array([[0.1], [0.2], [0.3]]), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 1)))
    fit = fit_inputs(model.A, model.C, [record(model, 500, seed=5)])
    np.testing.assert_allclose(fit.B, model.B, atol=1e-8)


def test_fit_inputs___unit_of_an_output_changes___input_matrix_does_not() -> None:
    model = random_model(3)
    data = record(model, 500, seed=6, noise=0.3)
    unit = np.array([1.0, 1000.0, 0.001])
    other = IoData(data.u, data.y * unit, dt_s=DT_S, inputs=data.inputs, outputs=data.outputs)
    here = fit_inputs(model.A, model.C, [data])
    there = fit_inputs(model.A, model.C * unit[:, np.newaxis], [other])
    np.testing.assert_allclose(there.B, here.B, atol=1e-9)
    np.testing.assert_allclose(there.error, here.error, rtol=1e-9)


def test_fit_inputs___state_that_no_output_sees___rank_tells() -> None:
    model = named(np.diag([0.5, 0.8]), np.ones((2, 1)), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    fit = fit_inputs(model.A, model.C, [record(model, 200, seed=7)])
    assert fit.rank == 2
    np.testing.assert_allclose(fit.B[0], 1.0, atol=1e-10)


def test_fit_inputs___strongly_unstable_matrix___raises() -> None:
    model = random_model(4)
    with pytest.raises(IdentificationError, match=r"magnitude 3\.\d+ grows .* stabilise"):
        fit_inputs(
            model.A * 3.2 / np.abs(np.linalg.eigvals(model.A)).max(),
            model.C,
            [record(model, 300, seed=8)],
        )


def test_fit_outputs___noise_free_record___recovers_the_output_matrix() -> None:
    model = random_model(5)
    data = record(model, 300, seed=9)
    x0 = fit_initial_states(model, [data])
    np.testing.assert_allclose(fit_outputs(model, x0, [data]), model.C, atol=1e-9)


def test_fit_initial_states___record_in_motion___free_response_is_matched() -> None:
    model = random_model(6, feedthrough=True)
    data = record(model, 100, seed=10)
    (x0,) = fit_initial_states(model, [data])
    np.testing.assert_allclose(step_by_step(model, data.u, x0), data.y, atol=1e-10)


@pytest.mark.parametrize("samples", [1, 31, 32, 33, 500])
def test_simulate___any_length___equals_the_recursion(samples: int) -> None:
    model = random_model(7, feedthrough=True)
    rng = np.random.default_rng(11)
    u, x0 = rng.normal(size=(samples, 2)), rng.normal(size=model.nstates)
    np.testing.assert_allclose(simulate(model, u, x0), step_by_step(model, u, x0), atol=1e-11)
    states = simulate_states(model.A, model.B, u, x0)
    np.testing.assert_allclose(
        states @ model.C.T + u @ model.D.T, step_by_step(model, u, x0), atol=1e-11
    )


def test_simulate___pulse___gives_the_markov_parameters() -> None:
    model = random_model(8, inputs=1, feedthrough=True)
    u = np.zeros((26, 1))
    u[0] = 1.0
    np.testing.assert_allclose(simulate(model, u), pulse_responses(model)[:, :, 0], atol=1e-12)
