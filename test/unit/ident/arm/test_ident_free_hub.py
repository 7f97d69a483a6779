"""Free hubs: a stiffness is taken out where no cable holds the joint, and stays where one does."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident.arm.fit import fit_arm
from flexarm_ident.friction.layout import Drive
from support.rubbing_arms import driven_arm

ROUNDING = 1e-9
DRIVES = [Drive("drive1_a", "joint1_rad")]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_fit___joint_without_a_cable___integrates(seed: int) -> None:
    fit = fit_arm(driven_arm(0.3, seed=seed, samples=3000), DRIVES)
    assert fit.free_hubs == (0,)
    eigenvalues = np.linalg.eigvals(fit.model.A)
    assert np.abs(eigenvalues - 1.0).min() < ROUNDING
    assert np.abs(eigenvalues).max() < 1.0 + ROUNDING


@pytest.mark.slow
def test_fit___joint_that_a_cable_holds___keeps_its_stiffness() -> None:
    fit = fit_arm(driven_arm(0.3, cable=2.0, samples=3000), DRIVES)
    assert fit.free_hubs == ()
    # A constant input of 1 turns the joint by 1 / cable.
    model = fit.model
    rest = model.C @ np.linalg.solve(np.eye(model.nstates) - model.A, model.B)
    assert rest[0, 0] == pytest.approx(0.5, rel=0.1)
