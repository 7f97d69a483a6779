"""Arm with dry friction: derivatives of its simulation error, and levels of records in motion."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident.friction.arm import FlexibleArm
from flexarm_ident.friction.arm_error import Part, SimulationError
from flexarm_ident.friction.arm_fit import fit_arm
from flexarm_ident.friction.layout import Drive
from flexarm_ident.friction.random_starts import RandomStarts
from support.rubbing_arms import rubbing_arm

ONE, TWO = (0.5,), (0.5, 0.3)
# Cut while a joint turns with 0.9 rad/s and more.
MOVING = [(ONE, 0, 830), (ONE, 2, 700), (TWO, 0, 660)]


def test_simulation_error___records_in_motion___has_the_gradient_of_differences() -> None:
    records = [rubbing_arm(TWO, seed=seed, samples=300, skip=700) for seed in range(2)]
    arm = FlexibleArm((0, 1), (1.0, 1.0), 4)
    parts = tuple(Part(each.u, each.y, np.ones_like(each.y)) for each in records)
    problem = SimulationError(arm, parts, records[0].dt_s, np.ones(2))
    theta = RandomStarts(problem, 5.0, np.random.default_rng(0)).start()
    assert len(theta) == arm.parameters + 2 * arm.motions
    step = 1e-6
    slopes = [
        (problem.cost(theta + step * way) - problem.cost(theta - step * way)) / (2.0 * step)
        for way in np.eye(len(theta))
    ]
    assert 2.0 * problem.normal(theta).gradient == pytest.approx(slopes, rel=1e-4, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("levels", "seed", "skip"), MOVING)
def test_fit___record_cut_in_mid_motion___finds_levels_and_first_motion(
    levels: tuple[float, ...], seed: int, skip: int
) -> None:
    record, joints = rubbing_arm(levels, seed=seed, skip=skip), len(levels)
    times_s = record.dt_s * np.arange(9)
    speeds, places = np.polyfit(times_s, record.y[:9, :joints], 1)
    assert np.abs(speeds).max() > 0.9
    drives = [
        Drive(name, output)
        for name, output in zip(record.inputs, record.outputs[:joints], strict=True)
    ]
    fit = fit_arm(record, drives)
    assert fit.friction.levels == pytest.approx(levels, rel=0.05)
    assert np.all(fit.error < 0.05)
    x0 = fit.x0[0]
    assert x0[:joints] == pytest.approx(places, abs=0.02)
    assert x0[2 * joints : 3 * joints] == pytest.approx(speeds, abs=0.25)
