"""Descent of a simulation error over all or some of its parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Minimum, Normal, minimise

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.arm.simulation_error import SimulationError

LAST_STEPS = 400
"""Steps after which nothing is left of what a start knew."""


def descend(
    problem: SimulationError,
    theta: FloatArray,
    *,
    iterations: int,
    free: NDArray[np.int_] | None = None,
) -> Minimum:
    """Return the minimum that is found from a start, among the allowed parameters.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    theta : ndarray, (parameters,)
        Start.
    iterations : int
        Largest number of steps.
    free : ndarray of int, optional
        Places of the parameters that move; all by default.

    Returns
    -------
    Minimum
        All parameters, the cost, and the normal matrix of those that move.
    """
    places = np.arange(len(theta)) if free is None else free

    def whole(part: FloatArray) -> FloatArray:
        joined = theta.copy()
        joined[places] = part
        return joined

    def normal(part: FloatArray) -> Normal:
        cost, gradient, matrix = problem.normal(whole(part))
        return Normal(cost, gradient[places], matrix[np.ix_(places, places)])

    found = minimise(
        theta[places],
        lambda part: problem.cost(whole(part)),
        normal,
        allowed=lambda part: problem.allowed(whole(part))[places],
        iterations=iterations,
    )
    return found._replace(theta=whole(found.theta))
