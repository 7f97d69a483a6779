"""Least correction: optimality conditions, all active sets by hand, and a general optimiser."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from flexarm_control.laws.strain_limit import least_correction

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

BOUND = 1.0


def problem(seed: int, values: int, parts: int) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Return weights, slack, moves and free values of a random problem, some beyond the bound."""
    draw = np.random.default_rng(seed)
    weights, slack = draw.uniform(0.1, 10.0, parts), 10.0 ** draw.uniform(-1.0, 4.0)
    return weights, slack, draw.normal(size=(values, parts)), 2.0 * draw.normal(size=values)


def cost(
    v: FloatArray, weights: FloatArray, slack: float, moves: FloatArray, free: FloatArray
) -> float:
    """Return the cost of a correction, written out."""
    beyond = np.maximum(0.0, np.abs(free + moves @ v) - BOUND)
    return float(0.5 * np.sum(weights * v**2) + 0.5 * slack * np.sum(beyond**2))


@given(seed=st.integers(0, 10_000), values=st.integers(1, 75), parts=st.integers(1, 9))
@settings(max_examples=60, deadline=None)
def test_correction___has_no_slope_of_the_cost(seed: int, values: int, parts: int) -> None:
    weights, slack, moves, free = problem(seed, values, parts)

    v = least_correction(weights, slack, moves, free, BOUND)

    predicted = free + moves @ v
    beyond = np.sign(predicted) * np.maximum(0.0, np.abs(predicted) - BOUND)
    slope = weights * v + slack * (moves.T @ beyond)
    scale = np.abs(slack * moves.T @ (free - np.clip(free, -BOUND, BOUND))).max()
    # The cost is strictly convex: where it has no slope is its minimum.
    np.testing.assert_allclose(slope, 0.0, atol=1e-8 * max(1.0, scale))


@pytest.mark.parametrize("seed", range(5))
def test_correction___is_the_best_of_all_active_sets(seed: int) -> None:
    weights, slack, moves, free = problem(seed, 4, 2)

    v = least_correction(weights, slack, moves, free, BOUND)

    found = []
    for sides in product((-1.0, 0.0, 1.0), repeat=4):
        rows = np.array(sides) != 0.0
        bent, wanted = moves[rows], np.array(sides)[rows] * BOUND - free[rows]
        hessian = np.diag(weights) + slack * bent.T @ bent
        candidate = np.linalg.solve(hessian, slack * bent.T @ wanted)
        found.append(cost(candidate, weights, slack, moves, free))
    assert cost(v, weights, slack, moves, free) == pytest.approx(min(found), rel=1e-9)


def test_correction___is_that_of_a_general_optimiser() -> None:
    args = problem(3, 30, 5)

    v = least_correction(*args, BOUND)

    best = minimize(cost, np.zeros(5), args, method="BFGS", options={"gtol": 1e-9})
    np.testing.assert_allclose(v, best.x, atol=1e-5)


def test_values_within_the_bound___need_no_correction() -> None:
    weights, slack, moves, free = problem(1, 20, 4)

    v = least_correction(weights, slack, moves, np.clip(free, -BOUND, BOUND), BOUND)

    np.testing.assert_array_equal(v, 0.0)
