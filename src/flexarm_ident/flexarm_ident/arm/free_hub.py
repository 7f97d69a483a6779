"""Free hubs: driven positions whose stiffness came out negative, and which have none.

Cables hold a hub by a small stiffness, and a free hub has none. The search may leave a small
negative one to either, with which the free motion of the arm grows. It is taken out and all other
parameters are fitted again, where this simulates the records equally well: an arm that gravity
turns over keeps it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.arm.descent import descend
from flexarm_ident.arm.level_profile import EQUALLY_GOOD, LevelProfile, law_figures

if TYPE_CHECKING:
    from flexarm_ident.arm.simulation_error import SimulationError
    from flexarm_ident.fitting.levenberg_marquardt import Minimum

_DESCENT = 60


class Freed(NamedTuple):
    """Profile whose best arm has no stiffness at some hubs, and the numbers of their inputs."""

    profile: LevelProfile
    hubs: tuple[int, ...]


def without_stiffness(problem: SimulationError, profile: LevelProfile) -> Freed:
    """Take out each negative stiffness without which the records are simulated equally well.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    profile : LevelProfile
        Its lowest minimum and the laws that are equally good.
    """
    best, hubs, tried = profile.best, list[int](), set[int]()
    first = problem.arm.blocks["stiffness"].start
    places = np.arange(len(best.theta))
    # Without one stiffness, the fit may give another one another sign.
    while left := [hub for hub in _negative(problem, best) if hub not in tried]:
        hub = left[0]
        tried.add(hub)
        theta = best.theta.copy()
        theta[first + hub] = 0.0
        free = np.delete(places, [first + each for each in (*hubs, hub)])
        found = descend(problem, theta, iterations=_DESCENT, free=free)
        if found.cost <= EQUALLY_GOOD * profile.best.cost:
            # What does not move has no deviation.
            matrix = np.zeros_like(profile.best.matrix)
            matrix[np.ix_(free, free)] = found.matrix
            best = found._replace(matrix=matrix)
            hubs.append(hub)
    own = law_figures(problem.arm.laws(best.theta))
    lowest, highest = np.minimum(profile.lowest, own), np.maximum(profile.highest, own)
    return Freed(LevelProfile(best, lowest, highest), tuple(hubs))


def _negative(problem: SimulationError, best: Minimum) -> list[int]:
    """Return the inputs whose hub has a negative stiffness."""
    found: list[int] = np.flatnonzero(best.theta[problem.arm.blocks["stiffness"]] < 0.0).tolist()
    return found
