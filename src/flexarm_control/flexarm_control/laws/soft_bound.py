"""Least correction that keeps predicted values within a bound, by a quadratic program.

A correction v of m parts moves predicted values f to f + G v. What is left beyond the bound costs
as the square, so there is always a solution::

    min  1/2 v' D v + s/2 sum max(0, |f + G v| - bound)^2

The cost is strictly convex, and quadratic between the places where a value passes the bound.
Newton's method with a line search ends at the minimum after finitely many steps [1]_: each step
solves the problem of the values that are beyond the bound, m equations.

References
----------
.. [1] Li, W., and Swetits, J. (1997). A new algorithm for solving strictly convex quadratic
   programs. SIAM Journal on Optimization 7(3), 595-619.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

MOST_STEPS = 12
"""Steps of Newton's method that a sample may take; the usual number is two to four."""
_MOST_HALVINGS = 8


def least_correction(
    weights: FloatArray, slack: float, moves: FloatArray, free: FloatArray, bound: float
) -> FloatArray:
    """Return the correction v, (m,); after `MOST_STEPS`, what is best so far.

    Parameters
    ----------
    weights : ndarray, (m,)
        Weights of the squares of the parts: the diagonal of D, positive.
    slack : float
        Weight s of the squares of what is beyond the bound, positive.
    moves : ndarray, (values, m)
        G.
    free : ndarray, (values,)
        Predicted values without a correction, f.
    bound : float
        Largest magnitude of a value, positive.
    """
    v = np.zeros(len(weights))
    beyond = free - np.clip(free, -bound, bound)
    cost = 0.5 * slack * float(beyond @ beyond)
    active = beyond != 0.0
    for _ in range(MOST_STEPS):
        if not active.any():
            break
        bent = moves[active]
        gradient = weights * v + slack * (beyond[active] @ bent)
        way = -np.linalg.solve(np.diag(weights) + slack * (bent.T @ bent), gradient)
        slope = float(gradient @ way)
        share = 1.0
        for _ in range(_MOST_HALVINGS):
            tried = v + share * way
            values = free + moves @ tried
            left = values - np.clip(values, -bound, bound)
            found = 0.5 * float(tried @ (weights * tried)) + 0.5 * slack * float(left @ left)
            if found <= cost + 1e-4 * share * slope:
                break
            share *= 0.5
        else:
            break
        v, beyond, cost = tried, left, found
        before, active = active, beyond != 0.0
        # The step was exact if no value passed the bound in it.
        if share == 1.0 and np.array_equal(before, active):
            break
    return v
