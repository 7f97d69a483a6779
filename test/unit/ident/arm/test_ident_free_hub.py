"""Free hubs: a negative stiffness is taken out where the records do not call for it."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident.arm.equations import FlexibleArm
from flexarm_ident.arm.fit import fit_arm, without_stiffness
from flexarm_ident.arm.simulation_error import LevelProfile, law_figures
from flexarm_ident.friction.layout import Drive
from support.quadratic_costs import Bowl
from support.rubbing_arms import driven_arm

ROUNDING = 1e-9
DRIVES = [Drive("drive1_a", "joint1_rad")]


@pytest.mark.parametrize(
    ("stiffness", "curvature", "hubs"),
    [(-0.1, 4.0, (0,)), (-0.1, 40.0, ()), (0.1, 4.0, ())],
    ids=["untold", "told", "a cable's"],
)
def test_stiffness___negative_and_untold___is_taken_out(
    stiffness: float, curvature: float, hubs: tuple[int, ...]
) -> None:
    bowl = Bowl({"stiffness": curvature}, stiffness=stiffness)
    own = law_figures(bowl.arm.laws(bowl.centre))
    freed = without_stiffness(bowl, LevelProfile(bowl.minimum, own, own))  # type: ignore[arg-type]
    assert freed.hubs == hubs
    best, places = freed.profile.best, bowl.arm.blocks["stiffness"]
    # Without it the cost is higher by the curvature times the square of the stiffness.
    assert best.cost == pytest.approx(1.0 + (curvature * stiffness**2 if hubs else 0.0))
    assert best.theta[places] == pytest.approx(0.0 if hubs else stiffness)
    assert best.matrix[places, places] == pytest.approx(0.0 if hubs else curvature)


class TwoHubs(Bowl):
    """Cost of an arm with two inputs, whose stiffnesses are coupled."""

    def __init__(self, stiffness: tuple[float, float], coupling: float) -> None:
        super().__init__({})
        self.arm = FlexibleArm((0, 1), (1.0, 1.0), 4)
        self.matrix = np.eye(self.arm.parameters)
        places = self.arm.blocks["stiffness"]
        self.matrix[places, places] = [[4.0, coupling], [coupling, 4.0]]
        self.centre = np.zeros(self.arm.parameters)
        self.centre[places] = stiffness


@pytest.mark.parametrize(
    ("stiffness", "hubs"), [((-0.1, -0.02), (0,)), ((0.02, -0.1), (1, 0)), ((0.1, 0.1), ())]
)
def test_stiffness___of_two_hubs___is_looked_at_again_when_one_is_free(
    stiffness: tuple[float, float], hubs: tuple[int, ...]
) -> None:
    # With one stiffness zero the other one moves by three quarters of it.
    bowl = TwoHubs(stiffness, coupling=-3.0 if stiffness[0] < 0.0 else 3.0)
    own = law_figures(bowl.arm.laws(bowl.centre))
    freed = without_stiffness(bowl, LevelProfile(bowl.minimum, own, own))  # type: ignore[arg-type]
    assert freed.hubs == hubs
    assert np.all(freed.profile.best.theta[bowl.arm.blocks["stiffness"]] > -ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.exhaustive
def test_fit___joint_without_a_cable___does_not_grow(seed: int) -> None:
    fit = fit_arm(driven_arm(0.3, seed=seed, samples=3000), DRIVES)
    assert np.abs(np.linalg.eigvals(fit.model.A)).max() < 1.0 + ROUNDING


@pytest.mark.slow
@pytest.mark.exhaustive
def test_fit___joint_that_a_cable_holds___keeps_its_stiffness() -> None:
    fit = fit_arm(driven_arm(0.3, cable=2.0, samples=3000), DRIVES)
    assert fit.free_hubs == ()
    # A constant input of 1 turns the joint by 1 / cable.
    model = fit.model
    rest = model.C @ np.linalg.solve(np.eye(model.nstates) - model.A, model.B)
    assert rest[0, 0] == pytest.approx(0.5, rel=0.1)
