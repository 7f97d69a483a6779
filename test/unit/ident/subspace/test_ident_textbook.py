"""Every method against its textbook form: explicit Hankel matrices, regressions and SVDs."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest

from flexarm_ident.subspace import orse
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.pbsid import predictor_space
from support.ident_systems import random_model, record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_ident import IoData
    from flexarm_ident.subspace.orse import RangeSpace

    Array = NDArray[np.float64]

Q, ORDER = 8, 5


class Form(NamedTuple):
    values: Array
    A: Array
    C: Array


def hankel(signal: Array, rows: int, first: int = 0, total: int | None = None) -> Array:
    """Return block rows `first` to `first + rows` of the Hankel matrix of `total` block rows."""
    columns = len(signal) - (total or rows) + 1
    return np.vstack([signal[i : i + columns].T for i in range(first, first + rows)])


def residual(of: Array, on: Array) -> Array:
    """Return what a regression of rows on rows leaves, by QR of the data themselves."""
    basis = np.linalg.qr(on.T)[0]
    return np.asarray(of - (of @ basis) @ basis.T)


def shifted(values: Array, basis: Array, scale: Array) -> Form:
    """Return A and C of base vectors by (2-10) and (2-9)."""
    psi, m = basis[:, :ORDER], len(scale)
    return Form(values, np.linalg.pinv(psi[:-m]) @ psi[m:], psi[:m] * scale[:, np.newaxis])


def without_instruments(data: IoData, scale: Array) -> Form:
    """Return (2-19) .. (2-23) of outputs divided by `scale`."""
    Y, U = hankel(data.y / scale, Q), hankel(data.u, Q)
    left = residual(Y, U)
    basis, values, _ = np.linalg.svd(left @ left.T)
    return shifted(values, basis, scale)


def innovation_deviation(y: Array, u: Array, rows: int) -> Array:
    m = y.shape[1]
    Y, U = hankel(y, rows), hankel(u, rows)
    left = residual(Y[-m:], np.vstack([Y[:-m], U]))
    return np.asarray(np.sqrt(np.mean(left**2, axis=1)))


def with_instruments(data: IoData, *, cva: bool) -> Form:
    """Return PO-MOESP or CVA by projections of the data."""
    past = np.vstack([hankel(z, Q, 0, 2 * Q) for z in (data.u, data.y)])
    U_f, Y_f = (hankel(z, Q, Q, 2 * Q) for z in (data.u, data.y))
    Z, Y = residual(past, U_f), residual(Y_f, U_f)
    left = residual(Y, Z)
    scale = innovation_deviation(data.y, data.u, 2 * Q)
    weight = np.diag(np.tile(1.0 / scale, Q))
    if cva:
        # The Cholesky factor is one of many roots of the covariance.
        weight = np.linalg.inv(np.linalg.cholesky(left @ left.T / Y.shape[1]))
    basis, values, _ = np.linalg.svd(weight @ (Y - left), full_matrices=False)
    unweighted = np.linalg.inv(weight) @ basis / np.tile(scale, Q)[:, np.newaxis]
    return shifted(values, unweighted, scale)


def assert_same(found: RangeSpace, known: Form) -> None:
    count = 3 * ORDER
    np.testing.assert_allclose(
        found.singular_values[:count] / found.singular_values[0],
        known.values[:count] / known.values[0],
        atol=1e-9,
    )
    A, C = found.matrices(ORDER)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(A)),
        np.sort_complex(np.linalg.eigvals(known.A)),
        rtol=1e-9,
    )
    # A basis of the states is free: the observability matrices must span the same space.
    fast = np.vstack([C @ np.linalg.matrix_power(A, k) for k in range(ORDER)])
    slow = np.vstack([known.C @ np.linalg.matrix_power(known.A, k) for k in range(ORDER)])
    basis = np.linalg.qr(slow)[0]
    np.testing.assert_allclose(basis @ (basis.T @ fast), fast, atol=1e-9 * np.abs(fast).max())


@pytest.fixture(params=range(3))
def data(request: pytest.FixtureRequest) -> IoData:
    seed = int(request.param)
    return record(random_model(seed), 900, seed=seed, noise=0.05)


def test_plain___noisy_mimo_data___equals_the_textbook_form(data: IoData) -> None:
    factors = np.array([1.0, 3.0, 0.2])
    assert_same(
        orse.plain(block_gram([data], Q), factors), without_instruments(data, 1.0 / factors)
    )


def test_innovation_scaled___noisy_mimo_data___equals_the_textbook_form(data: IoData) -> None:
    scale = innovation_deviation(data.y, data.u, Q)
    assert_same(orse.innovation_scaled(block_gram([data], Q)), without_instruments(data, scale))


@pytest.mark.parametrize("cva", [True, False])
def test_past_instruments___noisy_mimo_data___equals_the_textbook_form(
    data: IoData, *, cva: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(orse, "reaches_inputs", lambda _gram: not cva)
    space = orse.past_instruments(block_gram([data], 2 * Q))
    assert_same(space, with_instruments(data, cva=cva))


def test_predictor_space___noisy_mimo_data___equals_the_textbook_form(data: IoData) -> None:
    m, r, past = data.y.shape[1], data.u.shape[1], 10
    z = np.hstack([data.y, data.u])
    z = z / np.sqrt(np.mean([np.mean(z[i : len(z) - past + i] ** 2, axis=0) for i in range(11)], 0))
    H, c = hankel(z, past, 0, past + 1), m + r
    y, u = hankel(z[:, :m], 1, past, past + 1), hankel(z[:, m:], 1, past, past + 1)
    responses = np.linalg.lstsq(H.T, y.T)[0].T
    weight = 1.0 / np.sqrt(np.mean((y - responses @ H) ** 2, axis=1))
    future = np.vstack(
        [
            np.hstack([np.zeros((m, i * c)), responses[:, : (past - i) * c]])
            * weight[:, np.newaxis]
            for i in range(past)
        ]
    )
    left, values, _ = np.linalg.svd(future @ H / np.sqrt(H.shape[1]), full_matrices=False)
    rows = left[:, :ORDER].T @ future
    x, x_next = rows @ H, rows @ hankel(z, past, 1, past + 1)
    C = np.linalg.lstsq(x.T, y.T)[0].T
    e = y - C @ x
    A, B, K = np.split(np.linalg.lstsq(np.vstack([x, u, e]).T, x_next.T)[0].T, [5, 5 + r], axis=1)
    space = predictor_space(block_gram([data], past + 1))
    np.testing.assert_allclose(space.singular_values, values, atol=1e-9 * values[0])
    found = space.innovation(ORDER)
    unit = space.rms
    for power in range(6):
        step = C @ np.linalg.matrix_power(A, power)
        known = np.hstack([step @ B, step @ K]) * unit[:m, np.newaxis] / np.r_[unit[m:], unit[:m]]
        step = found.C @ np.linalg.matrix_power(found.A, power)
        np.testing.assert_allclose(
            np.hstack([step @ found.B, step @ found.K]), known, atol=1e-9 * np.abs(known).max()
        )
