"""Tests of the factor of a product matrix: its square is the matrix, whatever the rank."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_ident.subspace.inverse import factor, truncated_inverse


@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(1, 12),
    rank=st.integers(0, 14),
    decades=st.floats(0.0, 8.0),
)
def test_factor__products_of_any_rank___squares_to_them(
    seed: int, size: int, rank: int, decades: float
) -> None:
    rng = np.random.default_rng(seed)
    signals = rng.standard_normal((size, rank)) * 10.0 ** rng.uniform(-decades, 0.0, (size, 1))
    products = signals @ signals.T
    found = factor(products)
    assert found.shape == (size, size)
    rounding = 1e-13 * np.abs(products).max(initial=0.0)
    np.testing.assert_allclose(found @ found.T, products, rtol=0.0, atol=rounding)


@pytest.mark.parametrize("power", [0.0, 5e-324, 1e-320, 1e-250, 1e-30])
def test_truncated_inverse__almost_empty_direction___is_left_out_or_solved(power: float) -> None:
    matrix = np.diag([4.0, power])
    found = truncated_inverse(matrix, equilibrated=True)
    assert found.rank == (2 if power == 1e-30 else 1)
    np.testing.assert_allclose(found.solve(np.array([8.0, power])), [2.0, found.rank - 1.0])
