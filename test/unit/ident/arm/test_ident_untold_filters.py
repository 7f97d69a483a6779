"""Untold filters: one far above the sampling is left out, one within the band stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_ident.arm.equations import FlexibleArm
from flexarm_ident.arm.fit import RandomStarts, observed
from flexarm_ident.arm.simulation_error import Part, SimulationError
from flexarm_ident.fitting.levenberg_marquardt import Minimum
from support.rubbing_arms import rubbing_arm

NOISE = 0.01


@pytest.mark.parametrize(("bandwidth_rad_s", "states"), [(1e5, 4), (10.0, 6)])
@pytest.mark.parametrize("ratio", [1e-3, 0.7, 1.0])
def test_observed___filter_of_a_bend___is_left_out_where_it_changes_nothing(
    bandwidth_rad_s: float, states: int, ratio: float
) -> None:
    record = rubbing_arm((0.3,), samples=600)
    arm = FlexibleArm((0,), (1.0,), 2)
    part = Part(record.u, np.abs(record.u), record.y, np.ones_like(record.y))
    guess = SimulationError(arm, (part,), record.dt_s, np.ones(1))
    theta = RandomStarts(guess, 5.0, np.random.default_rng(0)).start()
    theta[arm.blocks["log_bandwidth"]] = np.log(bandwidth_rad_s)
    theta[arm.blocks["log_ratio"]] = np.log(ratio)
    (x,) = guess.states(theta)
    y = x @ arm.output_matrix.T
    noisy = y + NOISE * y.std(axis=0) * np.random.default_rng(1).normal(size=y.shape)
    problem = replace(guess, parts=(part._replace(y=noisy),))
    best = Minimum(theta, problem.cost(theta), np.eye(len(theta)))
    kept, C = observed(problem, best)
    assert kept.tolist() == list(range(states))
    missed = y - x[:, kept] @ C.T
    assert np.all(np.abs(missed) < NOISE * y.std(axis=0))
