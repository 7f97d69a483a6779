"""Refinement by simulation error: gradients, exact answers, never worse, a real record."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from flexarm_ident import IdentificationError, IoData
from flexarm_ident.arm.equations import FlexibleArm
from flexarm_ident.arm.fit import fit_arm
from flexarm_ident.arm.simulation_error import Part, SimulationError
from flexarm_ident.fitting.levenberg_marquardt import Normal, minimise
from flexarm_ident.fitting.modal_error import ModalError
from flexarm_ident.fitting.refinement import refine_model, relative_weights
from flexarm_ident.friction.layout import Drive
from flexarm_ident.models.stick_slip import run
from support.ident_systems import pulse_responses, random_model, record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def disturbed(model: control.StateSpace, seed: int, part: float) -> control.StateSpace:
    rng = np.random.default_rng(seed)
    A, B, C = (M * (1.0 + part * rng.normal(size=M.shape)) for M in (model.A, model.B, model.C))
    labels = {"inputs": model.input_labels, "outputs": model.output_labels}
    return control.ss(A, B, C, model.D, model.dt, **labels)


def test_minimise___rosenbrock___agrees_with_scipy() -> None:
    def residual(p: Array) -> Array:
        return np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])

    def normal(p: Array) -> Normal:
        J = np.array([[-20.0 * p[0], 10.0], [-1.0, 0.0]])
        e = residual(p)
        return Normal(float(e @ e), J.T @ e, J.T @ J)

    start = np.array([-1.2, 1.0])
    found = minimise(start, lambda p: normal(p).cost, normal, iterations=200, tolerance=1e-14)
    expected = optimize.least_squares(residual, start).x
    assert found.theta == pytest.approx(expected, abs=1e-5)


def test_minimise___allowed_half_plane___ends_at_its_edge() -> None:
    # |theta - (2, 3)|^2 with theta_0 <= 1 has its minimum at (1, 3).
    def normal(p: Array) -> Normal:
        e = p - [2.0, 3.0]
        return Normal(float(e @ e), e, np.eye(2))

    found = minimise(
        np.zeros(2),
        lambda p: normal(p).cost,
        normal,
        iterations=200,
        tolerance=1e-14,
        allowed=lambda p: np.minimum(p, [1.0, np.inf]),
    )
    assert found.theta == pytest.approx([1.0, 3.0], abs=1e-6)


def test_modal_error___unstable_parameters___come_back_to_the_circle() -> None:
    model = random_model(4)
    data = [record(model, 120, 1, noise=0.1)]
    problem = ModalError(model, data, relative_weights(data))
    theta = problem.pack([np.zeros(model.nstates)])
    np.testing.assert_array_equal(problem.allowed(theta), theta)
    outside = theta.copy()
    outside[: model.nstates] *= 3.0
    within, _ = problem.unpack(problem.allowed(outside))
    found, wanted = np.linalg.eigvals(within.A), 3.0 * np.linalg.eigvals(model.A)
    assert np.abs(found).max() < 1.0
    # The frequencies stay, and so does what lies inside.
    for eigenvalue in wanted:
        radius = min(abs(eigenvalue), 1.0 - 1e-8)
        assert np.abs(found - radius * eigenvalue / abs(eigenvalue)).min() < 1e-6


def test_minimise___start_overflows___is_returned() -> None:
    start = np.array([1.0])
    nothing = Normal(np.inf, np.zeros(1), np.eye(1))
    found = minimise(start, lambda _: np.inf, lambda _: nothing, iterations=5)
    assert found.cost == np.inf
    assert found.theta is start


@pytest.mark.parametrize("coloured", [False, True])
def test_modal_error___gradient___agrees_with_differences(*, coloured: bool) -> None:
    model = random_model(4)
    records = [record(model, 120, 1, noise=0.1), record(model, 90, 2, noise=0.1)]
    filters = relative_weights(records)
    if coloured:
        y = records[0].y.copy()
        y[40:60] = np.nan
        records[0] = replace(records[0], y=y)
        filters = [np.array([1.0, -0.7, 0.1])[: output + 1] for output in range(3)]
    problem = ModalError(disturbed(model, 0, 0.01), records, filters)
    theta = problem.pack([np.ones(5), -np.ones(5)])
    slopes = optimize.approx_fprime(theta, problem.cost, 1e-7)
    normal = problem.normal(theta)
    assert normal.cost == pytest.approx(problem.cost(theta), rel=1e-9)
    assert 2.0 * normal.gradient == pytest.approx(slopes, abs=1e-4 * np.abs(slopes).max())


def test_refinement___disturbed_start_of_clean_data___recovers_the_system() -> None:
    model = random_model(7)
    data = record(model, 2500, 3)
    refined = refine_model(disturbed(model, 1, 0.01), [np.zeros(5)], data, iterations=100)
    known = pulse_responses(model)
    assert refined.error.max() < 1e-6
    assert np.abs(pulse_responses(refined.model) - known).max() < 1e-5 * np.abs(known).max()


@given(seed=st.integers(0, 1000), noise=st.floats(0.0, 2.0), part=st.floats(0.0, 0.5))
@settings(max_examples=15)
def test_refinement___any_start___never_worse(seed: int, noise: float, part: float) -> None:
    model = random_model(seed % 20)
    data = record(model, 150, seed, noise=noise)
    start, x0 = disturbed(model, seed, part), [np.zeros(5)]
    refined = refine_model(start, x0, data, iterations=4)
    before, after = np.sum(refined.start_error**2), np.sum(refined.error**2)
    assert after <= before or not np.isfinite(before)
    if refined.model is start:
        assert refined.x0[0] is x0[0]


def arm_parameters(arm: FlexibleArm) -> Array:
    """Return a hub with one bending mode at about 3 Hz, a gauge and a level of 0.3."""
    theta = np.zeros(arm.parameters)
    theta[arm.blocks["mass"]] = (0.30, -0.03, 0.045)
    theta[arm.blocks["damping"]] = (0.5, 0.0, 0.03)
    theta[arm.blocks["log_gain"]] = np.log(2.0)
    theta[arm.blocks["gauges"]] = 0.7
    theta[arm.blocks["log_bandwidth"]], theta[arm.blocks["log_ratio"]] = np.log(60.0), np.log(0.8)
    theta[arm.blocks["log_level"]], theta[arm.blocks["offset"]] = np.log(0.3), 0.01
    return theta


def arm_record(samples: int = 3000, dt_s: float = 0.005) -> tuple[FlexibleArm, Array, IoData]:
    """Return a noisy record of that arm under a position loop, stepped one sample at a time."""
    arm = FlexibleArm((0,), (1.0,), 2)
    theta = arm_parameters(arm)
    A, B = arm.discrete(theta, dt_s)
    rng = np.random.default_rng(0)
    x, u, y = np.zeros(arm.states), np.zeros((samples, 1)), np.zeros((samples, 2))
    for k in range(samples):
        y[k] = arm.output_matrix @ x + (2e-3, 2e-3) * rng.normal(size=2)
        reference = np.sin(1.7 * k * dt_s) + (0.5 if (k // 400) % 2 else -0.5)
        u[k] = 3.0 * (reference - y[k, 0]) - 0.3 * arm.speed[0] @ x
        x = run(
            A,
            B,
            arm.speed,
            arm.laws(theta),
            np.zeros((arm.inputs, 2)),
            u[[k, k]] - 0.01,
            u[[k, k]],
            x,
        )[0][1]
    inputs, outputs = ("drive_a",), ("hub_rad", "gauge_v")
    data = IoData(u, y, dt_s=dt_s, inputs=inputs, outputs=outputs, closed_loop=True)
    return arm, theta, data


def test_arm___derivatives___agree_with_differences() -> None:
    arm = FlexibleArm((1, 0), (1.0, -1.0), 4)
    rng = np.random.default_rng(5)
    theta = rng.normal(size=arm.parameters)
    matrices = arm.discrete_with_derivatives(theta, 0.01)
    step = 1e-6
    for p in range(arm.blocks["log_ratio"].stop):
        change = step * np.eye(arm.parameters)[p]
        above, below = arm.discrete(theta + change, 0.01), arm.discrete(theta - change, 0.01)
        for slope, high, low in zip(matrices[2:], above, below, strict=True):
            expected = (high - low) / (2.0 * step)
            assert slope[..., p] == pytest.approx(
                expected, abs=1e-5 * max(1.0, np.abs(expected).max())
            )


def test_arm_error___gradient_through_stick_and_slip___agrees_with_differences() -> None:
    arm, theta, data = arm_record(400)
    part = Part(np.array(data.u), np.abs(data.u), data.y, np.ones_like(data.y))
    problem = SimulationError(arm, (part,), data.dt_s, np.array([0.5]))
    theta = np.concatenate([theta, np.zeros(arm.motions)])
    theta = theta + 0.02 * np.random.default_rng(1).normal(size=len(theta))
    slopes = np.array(
        [
            (problem.cost(theta + h) - problem.cost(theta - h)) / 2e-7
            for h in 1e-7 * np.eye(len(theta))
        ]
    )
    gradient = 2.0 * problem.normal(theta).gradient
    assert gradient == pytest.approx(slopes, abs=1e-3 * np.abs(slopes).max())


@pytest.mark.slow
@pytest.mark.exhaustive
def test_fit_arm___closed_loop_without_compensation___finds_level_and_simulates() -> None:
    _, _, data = arm_record()
    fit = fit_arm(data, [Drive("drive_a", "hub_rad")])
    assert fit.friction.levels == pytest.approx([0.3], rel=0.05)
    assert np.abs(fit.friction.levels - 0.3) <= fit.friction.level_deviations
    assert np.all(fit.law_ranges[:, 0, 0] <= fit.friction.levels)
    assert np.all(fit.friction.levels <= fit.law_ranges[:, 0, 1])
    assert abs(fit.friction.offsets[0] - 0.01) < 0.02
    assert np.all(fit.error < 0.04)


def test_fit_arm___input_without_position___raises() -> None:
    _, _, data = arm_record(400)
    with pytest.raises(IdentificationError, match="one position for every input"):
        fit_arm(data, [])
