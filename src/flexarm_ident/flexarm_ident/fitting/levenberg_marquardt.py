"""Nonlinear least squares by Levenberg and Marquardt, for costs that may overflow."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_core.arrays import FloatArray, Progress

_FIRST_DAMPING = 1e-2
_SMALLEST_DAMPING = 1e-8
_RAISE = 4.0
_LOWER = 6.0
_TRIALS = 10
_RIDGE = 1e-9


class Normal(NamedTuple):
    """Normal equations at one point: cost, gradient ``J' e`` and ``J' J``."""

    cost: float
    gradient: FloatArray
    matrix: FloatArray


class Minimum(NamedTuple):
    """Result of the search: parameters, cost and the last normal matrix."""

    theta: FloatArray
    cost: float
    matrix: FloatArray


def minimise(
    theta: FloatArray,
    cost: Callable[[FloatArray], float],
    normal: Callable[[FloatArray], Normal],
    *,
    iterations: int,
    tolerance: float = 1e-5,
    allowed: Callable[[FloatArray], FloatArray] = lambda theta: theta,
    on_step: Callable[[], None] = lambda: None,
) -> Minimum:
    """Minimise a sum of squares from a start; the result is never worse.

    Parameters
    ----------
    theta : ndarray, (parameters,)
        Start.
    cost : callable
        Sum of squares; not finite where the model overflows.
    normal : callable
        Normal equations.
    iterations : int
        Largest number of steps.
    tolerance : float
        Relative decrease of the cost below which the search stops.
    allowed : callable
        Projection of a step's end onto the parameters that are allowed, such as stable models.
    on_step : callable
        Called before the normal equations of each point.

    Returns
    -------
    Minimum
        The lowest point and the last normal matrix; its cost is infinite when the start overflows.
    """
    on_step()
    start = normal(theta)
    best = Minimum(theta, start.cost, start.matrix)
    if not _finite(start):
        return Minimum(theta, np.inf, np.eye(len(theta)))
    damping = _FIRST_DAMPING
    equations = start
    for _ in range(iterations):
        weight = np.diag(equations.matrix) + _RIDGE * np.trace(equations.matrix) / len(theta)
        weight = np.where(weight > 0.0, weight, 1.0)
        gain = 0.0
        for _ in range(_TRIALS):
            step = np.linalg.solve(equations.matrix + np.diag(damping * weight), equations.gradient)
            trial = allowed(best.theta - step)
            lower = cost(trial)
            if np.isfinite(lower) and lower < best.cost:
                gain = (best.cost - lower) / best.cost
                break
            damping *= _RAISE
        if gain == 0.0:
            break
        damping = max(damping / _LOWER, _SMALLEST_DAMPING)
        on_step()
        trial_equations = normal(trial)
        if not _finite(trial_equations):
            break
        equations = trial_equations
        best = Minimum(trial, lower, equations.matrix)
        if gain < tolerance:
            break
    return best


def step_reporter(progress: Progress | None, stage: str, steps: int) -> Callable[[], None]:
    """Return a callback for each step of a search; it reports the part of `steps` done."""
    done = count()

    def report() -> None:
        if progress is not None:
            progress(stage, min(1.0, next(done) / steps))

    return report


def _finite(equations: Normal) -> bool:
    finite = np.isfinite(equations.cost) and np.isfinite(equations.gradient).all()
    return bool(finite and np.isfinite(equations.matrix).all())
