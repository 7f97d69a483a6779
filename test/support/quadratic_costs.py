"""Quadratic costs in the place of an arm's simulation error, with answers that are known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.arm.equations import FlexibleArm
from flexarm_ident.fitting.levenberg_marquardt import Minimum, Normal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Bowl:
    """Quadratic cost over the parameters of an arm with one input, with its lowest value 1.

    Its curvatures are 1 but for those given by kind of parameter. The lowest place has the level
    0.3, which is coupled with the first parameter, and a given stiffness.
    """

    def __init__(
        self, curvatures: Mapping[str, float], coupling: float = 0.0, stiffness: float = 0.0
    ) -> None:
        self.arm = FlexibleArm((0,), (1.0,), 2)
        count, place = self.arm.parameters, self.arm.blocks["log_level"].start
        self.matrix = np.eye(count)
        for kind, curvature in curvatures.items():
            own = self.arm.blocks[kind].start
            self.matrix[own, own] = curvature
        self.matrix[place, 0] = self.matrix[0, place] = coupling
        self.centre = np.zeros(count)
        self.centre[place] = np.log(0.3)
        self.centre[self.arm.blocks["stiffness"]] = stiffness

    def cost(self, theta: Array) -> float:
        """Return the cost."""
        moved = theta - self.centre
        return float(1.0 + moved @ self.matrix @ moved)

    def normal(self, theta: Array) -> Normal:
        """Return the normal equations."""
        return Normal(self.cost(theta), self.matrix @ (theta - self.centre), self.matrix)

    def allowed(self, theta: Array) -> Array:
        """Return the parameters: all are allowed."""
        return theta

    @property
    def minimum(self) -> Minimum:
        """The lowest place."""
        return Minimum(self.centre, 1.0, self.matrix)
