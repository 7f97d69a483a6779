"""Constrained search for gains from one starting point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from flexarm_control.laws.gains import PdpGains, PiGains

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_core.arrays import FloatArray

_GainsT = TypeVar("_GainsT", PdpGains, PiGains)

# Large enough to repel the search from an unstable loop, small enough for its arithmetic.
_WORST = 1e3
_MET_WITHIN = 0.01
# Kernels of linear algebra round differently, and a gradient over a tiny step makes another way of
# that: so steps are wide, and values have the digits that all kernels share.
_STEP = 1e-3
_SHARED_DECIMALS = 10


@dataclass(frozen=True)
class Search(Generic[_GainsT]):
    """Result of the search from one starting point.

    Attributes
    ----------
    start, gains : PdpGains or PiGains
        Starting point and end of the search.
    criterion : float
        Value of the criterion at the end.
    feasible : bool
        True if the end meets every constraint.
    """

    start: _GainsT
    gains: _GainsT
    criterion: float
    feasible: bool


def search(
    kind: type[_GainsT],
    criterion: Callable[[FloatArray], float],
    start: _GainsT,
    bounds: tuple[tuple[float, float], ...],
    excess: Callable[[FloatArray], FloatArray],
) -> Search[_GainsT]:
    """Minimise a criterion over gains by sequential quadratic programming.

    Parameters
    ----------
    kind : type of PdpGains or PiGains
        Class of the gains.
    criterion : callable
        Value of the criterion for an array of gains.
    start : PdpGains or PiGains
        Starting point.
    bounds : tuple of tuple of float
        Lower and upper bound of every gain.
    excess : callable
        Margin of every constraint for an array of gains, at least zero where it is met.

    Returns
    -------
    Search
        End of the search, feasible or not.
    """
    # This import takes half a second, and a running controller never searches.
    from scipy.optimize import NonlinearConstraint, minimize  # noqa: PLC0415

    lower, upper = np.transpose(bounds)

    def bounded_criterion(values: FloatArray) -> float:
        # The response of an unstable loop may overflow; it then has the worst value.
        with np.errstate(over="ignore", invalid="ignore"):
            value = criterion(np.clip(values, lower, upper))
        value = min(value, _WORST) if np.isfinite(value) else _WORST
        return float(np.round(value, _SHARED_DECIMALS))

    def bounded_excess(values: FloatArray) -> FloatArray:
        return np.round(excess(np.clip(values, lower, upper)), _SHARED_DECIMALS)

    # Both clip their argument: the optimiser oversteps its bounds by rounding errors.
    result = minimize(
        bounded_criterion,
        np.clip(gain_values(start), lower, upper),
        method="SLSQP",
        jac="3-point",
        bounds=bounds,
        constraints=NonlinearConstraint(bounded_excess, 0.0, np.inf),
        options={"ftol": 1e-6, "maxiter": 200, "finite_diff_rel_step": _STEP},
    )
    found = np.clip(result.x, lower, upper)
    value = bounded_criterion(found)
    return Search(
        start=start,
        gains=kind(*found.tolist()),
        criterion=value,
        feasible=value < _WORST and bool(np.all(bounded_excess(found) >= -_MET_WITHIN)),
    )


def unconstrained(values: FloatArray) -> FloatArray:
    """Return the excess for a search without constraints."""
    return np.zeros_like(values)


def gain_values(gains: PdpGains | PiGains) -> FloatArray:
    """Return the gains as an array, in the order of the fields."""
    return np.array(list(vars(gains).values()))
