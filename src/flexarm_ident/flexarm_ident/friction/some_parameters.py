"""Minimum of a simulation error over some of its parameters, with the others fixed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Minimum, Normal, minimise

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.friction.arm_error import SimulationError


def minimise_some(
    problem: SimulationError, theta: FloatArray, free: NDArray[np.int_], *, iterations: int
) -> Minimum:
    """Return the minimum over the parameters at some places.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    theta : ndarray, (parameters,)
        Start, and values of the others.
    free : ndarray of int
        The places.
    iterations : int
        Largest number of steps.

    Returns
    -------
    Minimum
        All parameters, the cost, and the normal matrix of the free ones.
    """

    def whole(part: FloatArray) -> FloatArray:
        joined = theta.copy()
        joined[free] = part
        return joined

    def normal(part: FloatArray) -> Normal:
        cost, gradient, matrix = problem.normal(whole(part))
        return Normal(cost, gradient[free], matrix[np.ix_(free, free)])

    found = minimise(
        theta[free], lambda part: problem.cost(whole(part)), normal, iterations=iterations
    )
    return found._replace(theta=whole(found.theta))
