"""Profile of the friction: the laws with which a record is simulated equally well.

The curvature of the cost at one minimum says little where the friction trades with damping and
gain, and where the cost has several minima. Each level, rise and load is therefore moved away from
the best fit in steps, all other parameters are fitted again, and so on until the cost stands out.
The laws of other minima count as well.

Venzon, Moolgavkar, "A method for computing profile-likelihood-based confidence intervals", Applied
Statistics 37 (1988).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.arm.simulation_error import descend

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.arm.simulation_error import SimulationError
    from flexarm_ident.fitting.levenberg_marquardt import Minimum

# A cost 10 % above the smallest is an error 5 % above it, less than two halves of a record differ.
EQUALLY_GOOD = 1.1
"""Cost in units of the smallest up to which the records are simulated equally well."""
_MOVED = ("log_level", "log_rise", "log_load")
_STEP = 0.06
_STEPS = 8
_ITERATIONS = 12
DESCENT = 60
_RESTARTS = 2
_LOWER = 0.995


class LevelProfile(NamedTuple):
    """Lowest minimum that was met, and the range of `law_figures` that are equally good."""

    best: Minimum
    lowest: FloatArray
    highest: FloatArray


def profile_levels(
    problem: SimulationError, best: Minimum, others: Sequence[Minimum]
) -> LevelProfile:
    """Return the range of friction laws whose cost is at most 10 % above the smallest.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    best : Minimum
        Its lowest minimum so far. A lower one that the profile meets takes its place.
    others : sequence of Minimum
        Further minima.
    """
    points = [(each.theta, problem.cost(each.theta)) for each in (best, *others)]
    for _ in range(_RESTARTS + 1):
        start, lower = best, best
        for point in _moved(problem, best):
            points.append((point.theta, point.cost))
            if point.cost < _LOWER * lower.cost:
                lower = point
                break
        if lower is start:
            break
        best = descend(problem, lower.theta, iterations=DESCENT)
        points.append((best.theta, best.cost))
    limit = EQUALLY_GOOD * best.cost
    good = [law_figures(problem.arm.laws(theta)) for theta, cost in points if cost <= limit]
    return LevelProfile(best, np.min(good, axis=0), np.max(good, axis=0))


def law_figures(laws: FloatArray) -> FloatArray:
    """Return laws, (inputs, 4), and what holds at standstill: Coulomb level and rise together.

    The two trade with each other, so that a record determines their sum better than either.
    """
    return np.column_stack([laws, laws[:, 0] + laws[:, 1]])


def _moved(problem: SimulationError, best: Minimum) -> Iterator[Minimum]:
    """Yield minima with one parameter fixed, further and further from the best fit."""
    places = np.arange(len(best.theta))
    for place in np.concatenate([places[problem.arm.blocks[name]] for name in _MOVED]):
        free = np.delete(places, place)
        for step in (-_STEP, _STEP):
            theta = best.theta
            for _ in range(_STEPS):
                moved = theta.copy()
                moved[place] += step
                if problem.allowed(moved)[place] != moved[place]:
                    break
                found = descend(problem, moved, iterations=_ITERATIONS, free=free)
                yield found
                if not found.cost <= EQUALLY_GOOD * best.cost:
                    break
                theta = found.theta
