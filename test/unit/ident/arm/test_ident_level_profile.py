"""Profile of friction levels, on costs whose answer is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.arm.simulation_error import profile_levels
from flexarm_ident.fitting.levenberg_marquardt import Minimum
from support.quadratic_costs import Bowl

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@pytest.mark.parametrize(("curvature", "coupling"), [(4.0, 0.0), (4.0, 1.6), (40.0, 0.0)])
def test_profile___quadratic_cost___reaches_to_ten_percent_above_it(
    curvature: float, coupling: float
) -> None:
    bowl = Bowl({"log_level": curvature}, coupling)
    profile = profile_levels(bowl, bowl.minimum, [])  # type: ignore[arg-type]
    # With the other parameters at their best, the curvature is the Schur complement.
    reach = np.sqrt(0.1 / (curvature - coupling**2))
    steps = 0.06 * np.floor(reach / 0.06 + 1e-9)
    assert np.log(profile.highest[0, 0] / 0.3) == pytest.approx(steps, abs=1e-3)
    assert np.log(profile.lowest[0, 0] / 0.3) == pytest.approx(-steps, abs=1e-3)


def test_profile___start_beside_the_minimum___moves_there() -> None:
    bowl = Bowl({"log_level": 40.0})
    aside = bowl.centre.copy()
    aside[bowl.arm.blocks["log_level"]] += 0.3
    start = Minimum(aside, bowl.cost(aside), bowl.matrix)
    profile = profile_levels(bowl, start, [])  # type: ignore[arg-type]
    assert bowl.arm.levels(profile.best.theta)[0] == pytest.approx(0.3, rel=1e-3)


def test_profile___another_minimum_as_good___counts() -> None:
    bowl = Bowl({"log_level": 40.0})

    class TwoBowls(Bowl):
        def cost(self, theta: Array) -> float:
            other = theta.copy()
            other[self.arm.blocks["log_level"]] -= np.log(2.0)
            return min(super().cost(theta), super().cost(other))

    two = TwoBowls({"log_level": 40.0})
    far = two.centre.copy()
    far[two.arm.blocks["log_level"]] += np.log(2.0)
    profile = profile_levels(two, bowl.minimum, [Minimum(far, 1.0, two.matrix)])  # type: ignore[arg-type]
    assert profile.highest[0, 0] == pytest.approx(0.6)
