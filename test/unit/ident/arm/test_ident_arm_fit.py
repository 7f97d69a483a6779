"""Arm with dry friction: derivatives of its simulation error, and levels of records in motion."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident import IdentificationError
from flexarm_ident.arm import fit as arm_fit
from flexarm_ident.arm.equations import FlexibleArm, FrictionModel
from flexarm_ident.arm.fit import RandomStarts, fit_arm
from flexarm_ident.arm.simulation_error import Part, SimulationError
from flexarm_ident.friction.layout import Drive
from support.rubbing_arms import rubbing_arm

if TYPE_CHECKING:
    from flexarm_ident.fitting.levenberg_marquardt import Minimum

ONE, TWO = (0.5,), (0.5, 0.3)
BOTH = FrictionModel.STRIBECK | FrictionModel.LOAD
# What a friction model adds to each joint: rise, speed over which it fades, load.
NEW = {
    FrictionModel.COULOMB: (),
    FrictionModel.STRIBECK: (0.2, 0.3),
    FrictionModel.LOAD: (0.1,),
    BOTH: (0.2, 0.3, 0.1),
}


@pytest.mark.parametrize(
    "friction_model", [FrictionModel.COULOMB, FrictionModel.STRIBECK, FrictionModel.LOAD, BOTH]
)
def test_simulation_error___records_in_motion___has_the_gradient_of_differences(
    friction_model: FrictionModel,
) -> None:
    records = [rubbing_arm(TWO, seed=seed, samples=300, skip=700) for seed in range(2)]
    arm = FlexibleArm((0, 1), (1.0, 1.0), 4, friction_model)
    new = np.repeat(NEW[friction_model], 2)
    parts = tuple(Part(each.u, np.abs(each.u), each.y, np.ones_like(each.y)) for each in records)
    problem = SimulationError(arm, parts, records[0].dt_s, np.ones(2))
    coulomb = replace(problem, arm=replace(arm, friction_model=FrictionModel.COULOMB))
    theta = RandomStarts(coulomb, 5.0, np.random.default_rng(0)).start()
    theta = np.insert(theta, [coulomb.arm.parameters] * len(new), np.log(new))
    assert len(theta) == arm.parameters + 2 * arm.motions
    assert np.count_nonzero(problem.normal(theta).gradient) == len(theta)
    step = 1e-6
    slopes = [
        (problem.cost(theta + step * way) - problem.cost(theta - step * way)) / (2.0 * step)
        for way in np.eye(len(theta))
    ]
    assert 2.0 * problem.normal(theta).gradient == pytest.approx(slopes, rel=1e-4, abs=1e-4)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_fit___no_start_beats_the_other_model___ends_after_the_first_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record = rubbing_arm(ONE, seed=3, skip=0, samples=600)
    noise = np.random.default_rng(3).normal(size=record.y.shape) * record.y.std(axis=0)
    noisy = replace(record, y=record.y + noise)
    seen: list[int] = []
    whole = arm_fit._finalists

    def counted(problem: SimulationError, draw: RandomStarts, *others: object) -> list[Minimum]:
        seen.append(1)
        return whole(problem, draw, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(arm_fit, "_finalists", counted)
    monkeypatch.setattr(arm_fit, "_STARTS", 6)
    drives = [Drive(record.inputs[0], record.outputs[0])]
    # Half the power of the outputs is noise: no model has a tenth of their RMS as its error.
    with pytest.raises(IdentificationError, match="no better than the linear model"):
        fit_arm(noisy, drives, error_to_beat=np.full(2, 0.1))
    assert seen == [1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("levels", "skip", "samples"),
    # Cut while a joint turns with 0.9 rad/s and more.
    [(ONE, 830, 3000), (TWO, 660, 1500)],
)
@pytest.mark.exhaustive
def test_fit___record_cut_in_mid_motion___finds_levels_and_first_motion(
    levels: tuple[float, ...], skip: int, samples: int
) -> None:
    record, joints = rubbing_arm(levels, skip=skip, samples=samples), len(levels)
    times_s = record.dt_s * np.arange(9)
    speeds, places = np.polyfit(times_s, record.y[:9, :joints], 1)
    assert np.abs(speeds).max() > 0.9
    drives = [
        Drive(name, output)
        for name, output in zip(record.inputs, record.outputs[:joints], strict=True)
    ]
    fit = fit_arm(record, drives)
    assert fit.friction_model == FrictionModel.COULOMB
    assert fit.friction.levels == pytest.approx(levels, rel=0.05)
    # Most starts end in another valley, where a bend lacks a mode and errs by 0.06.
    assert np.all(fit.error < 0.05)
    x0 = fit.x0[0]
    assert x0[:joints] == pytest.approx(places, abs=0.02)
    assert x0[2 * joints : 3 * joints] == pytest.approx(speeds, abs=0.25)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rise", "load", "friction_model"),
    [
        pytest.param(0.5, 0.0, FrictionModel.STRIBECK, marks=pytest.mark.exhaustive),
        pytest.param(0.0, 0.15, FrictionModel.LOAD, marks=pytest.mark.exhaustive),
        (0.5, 0.15, BOTH),
    ],
)
def test_fit___friction_of_each_model___is_chosen_by_halves_left_out(
    rise: float, load: float, friction_model: FrictionModel
) -> None:
    record = rubbing_arm(ONE, rise=rise, load=load, seed=1)
    fit = fit_arm(record, [Drive("drive1_a", "joint1_rad")])
    assert fit.friction_model == friction_model
    assert np.all(np.array(fit.left_out[friction_model]) < fit.left_out[FrictionModel.COULOMB])
    assert fit.friction.levels == pytest.approx(ONE, rel=0.15)
    if friction_model & FrictionModel.LOAD:
        # One level more than the load trades with.
        assert fit.friction.laws[:, 3] == pytest.approx([load], rel=0.45)
        assert fit.friction.dependence is not None
        scatter = fit.friction.dependence.load_deviations
        assert np.abs(fit.friction.laws[:, 3] - load) <= scatter
    if friction_model & FrictionModel.STRIBECK:
        # The speed of the rise trades with its height: what is certain is that there is one.
        assert np.all(fit.friction.laws[:, 1] > 0.3 * rise * ONE[0])
        assert np.all(fit.friction.laws[:, 1] < 1.5 * rise * ONE[0])
