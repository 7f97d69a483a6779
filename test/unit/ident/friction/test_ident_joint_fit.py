"""Linear models with yielding friction at their joints: steps, derivatives, fit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy

from flexarm_ident import IoData, identify
from flexarm_ident.friction.dry_friction import (
    DryFriction,
    Yielding,
    friction_fields,
    load_friction,
    simulate_with_friction,
)
from flexarm_ident.friction.guided_steps import guided_steps
from flexarm_ident.friction.joint_fit import JointFit, fit_joints
from flexarm_ident.friction.layout import Drive, joints
from flexarm_ident.friction.levels import CoulombEstimate, estimate_coulomb, net_record
from flexarm_ident.models.files import save_model
from flexarm_ident.models.state_space import state_space

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import control

    from flexarm_core.arrays import FloatArray

DT_S = 0.002
LEVEL = 0.12
NONE = np.zeros(1)


def _arm(level: float, spring: float = 0.0) -> tuple[control.StateSpace, DryFriction]:
    """Return an arm of hub and one bending mode, with encoder, gauge and gyroscope of the tip.

    A spring, in N m/rad, draws the hub back.
    """
    inertia = np.array([[0.06, 0.02], [0.02, 0.01]])
    stiffness, damping = np.diag([spring, 25.0]), np.diag([0.05, 0.005])
    A = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-np.linalg.solve(inertia, stiffness), -np.linalg.solve(inertia, damping)],
        ]
    )
    B = np.vstack([np.zeros((2, 1)), np.linalg.solve(inertia, [[1.0], [0.0]])])
    C = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 1.5]])
    A_d, B_d, *_ = scipy.signal.cont2discrete((A, B, C, np.zeros((3, 1))), DT_S)
    model = state_space(
        A_d, B_d, C, 0.0, DT_S, inputs=["torque"], outputs=["encoder", "gauge", "gyro"]
    )
    yielding = Yielding(np.array([0.8]), np.array([0.1]))
    speed = np.array([[0.0, 0.0, 1.0, 0.0]])
    return model, DryFriction(np.array([level]), NONE, NONE, NONE, speed, yielding=yielding)


def _record(samples: int, level: float = LEVEL, spring: float = 0.0) -> IoData:
    """Return a closed loop around random set-points, with dither and noise of the sensors."""
    rng = np.random.default_rng(3)
    model, friction = _arm(level, spring)
    x, goal, u = np.zeros(4), 0.0, np.empty((samples, 1))
    for k in range(samples):
        if k % 300 == 0:
            goal = rng.uniform(-1.0, 1.0)
        u[k] = 1.5 * (goal - x[0]) - 0.4 * x[2] + 0.15 * rng.standard_normal()
        one = simulate_with_friction(model, friction, u[[k, k]], x)[1][0]
        x = model.A @ x + model.B @ (u[k] - one)
    y, _ = simulate_with_friction(model, friction, u, np.zeros(4))
    noise = 0.0015 * y.std(axis=0) * rng.standard_normal(y.shape)
    outputs = ("encoder", "gauge", "gyro")
    return IoData(u, y + noise, dt_s=DT_S, inputs=("torque",), outputs=outputs)


def test_friction_below_its_level___yielding___leaves_its_part_of_the_speed() -> None:
    decay = state_space([[1.0]], [[0.1]], [[1.0]], 0.0, DT_S)
    rest = Yielding(np.array([0.8]), NONE)
    friction = DryFriction(np.array([10.0]), NONE, NONE, NONE, np.eye(1), yielding=rest)

    y, _ = simulate_with_friction(decay, friction, np.full((20, 1), 0.3), np.ones(1))

    np.testing.assert_allclose(y[:, 0], 0.8 ** np.arange(20))


def test_yielding___file___is_read_as_written(tmp_path: Path) -> None:
    model, friction = _arm(LEVEL)
    path = tmp_path / "arm.yaml"

    save_model(path, model, name="arm", provenance=friction_fields(friction))
    found = load_friction(path)

    assert found is not None
    np.testing.assert_allclose(found.holds, friction.holds)


@pytest.mark.parametrize("kind", ["mode", "rigid motion"])
def test_derivatives_of_guided_steps___every_parameter___are_those_of_differences(
    kind: str,
) -> None:
    rng, rigid = np.random.default_rng(0), kind == "rigid motion"
    pair, motion = np.array([1, 0, 2]), np.array([rigid, rigid, False])
    first = np.concatenate(
        [
            [0.95, 0.2, 0.99, 0.05, 0.1, 0.08],
            rng.standard_normal(6),
            rng.standard_normal(3),
            [0.3, 0.5, 0.1, 0.02],
            [0.5, 0.6, 1.0],
        ]
    )
    gain = 0.1 * rng.standard_normal((3, 2))
    u, y = rng.standard_normal((40, 1)), rng.standard_normal((40, 2))

    def stepped(theta: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        A = np.diag([theta[0], theta[0], theta[2]])
        A[0, 1], A[1, 0] = theta[1], -theta[1]
        if rigid:
            A[:2, :2] = [[1.0, 1.0], [-theta[0], theta[1]]]
        return guided_steps(
            *(A, theta[3:6, np.newaxis].copy(), theta[6:12].reshape(2, 3).copy()),
            *(pair, motion, gain, theta[19:].reshape(1, 3).copy()),
            *(theta[15:18].reshape(3, 1).copy(), u - theta[18], y, theta[12:15].copy(), slopes),
        )

    slopes = np.zeros((3, len(first)))
    slopes[:, 12:15] = np.eye(3)
    found = stepped(first, slopes)[:, :, :-1]

    step = 1e-7
    for place, way in enumerate(np.eye(len(first))):
        ends = [stepped(first + side * way, np.zeros((3, 0)))[..., 0] for side in (step, -step)]
        np.testing.assert_allclose(
            found[:, :, place], (ends[1] - ends[0]) / (2.0 * step), rtol=1e-4, atol=1e-5
        )


def _linear(record: IoData, order: int) -> tuple[control.StateSpace, FloatArray]:
    found = identify(record, friction=False, feedthrough=False, method="pbsid", order=order)
    return found.model, found.x0[0]


def _fitted(record: IoData, orders: Sequence[int] = (2, 4, 6)) -> JointFit:
    """Return the fit from starts of several orders."""
    drives = joints([record])
    assert drives is not None
    assert [drive.output for drive in drives] == ["encoder"]
    net = net_record(record, estimate_coulomb(record, drives))
    starts = [[_linear(each, order) for each in (net, record)] for order in orders]
    fit = fit_joints(starts[0][1][0], starts, record, drives, np.array([0.8 * LEVEL]))
    assert fit is not None
    return fit


@pytest.mark.slow
def test_arm_with_a_gyroscope___fit___finds_level_and_simulates_to_the_noise() -> None:
    fit = _fitted(_record(12_000))

    assert fit.is_better
    assert fit.model.nstates >= 4
    deviation = fit.friction.level_deviations[0]
    assert abs(fit.friction.levels[0] - LEVEL) < 2.0 * deviation < 0.1 * LEVEL
    assert np.all(fit.error < 3.0 * 0.0015)
    values, vectors = np.linalg.eig(fit.model.A)
    assert np.abs(values).max() <= 1.0
    still = vectors[:, np.argmin(np.abs(values - 1.0))]
    # Where the hub turned to is no part of its speed.
    assert np.linalg.norm(fit.friction.speed @ still) < 1e-6 * np.linalg.norm(fit.friction.speed)


@pytest.mark.slow
def test_joint_drawn_back_by_a_spring___fit___keeps_its_stiffness() -> None:
    fit = _fitted(_record(8000, spring=0.4), orders=(4,))

    model = fit.model
    at_rest = np.linalg.solve(np.eye(model.nstates) - model.A, model.B)
    assert (model.C @ at_rest)[0, 0] == pytest.approx(1.0 / 0.4, rel=0.05)
    assert fit.friction.levels[0] == pytest.approx(LEVEL, rel=0.03)


def test_output_that_drifts_with_any_model___judging___does_not_outweigh_the_others() -> None:
    model, friction = _arm(LEVEL)
    own, linear = np.array([0.8, 0.05, 0.06]), np.array([0.7, 0.06, 0.14])
    fit = JointFit(model, np.zeros(4), friction, own, own, linear)

    assert fit.left_out_means == pytest.approx((np.cbrt(np.prod(own)), np.cbrt(np.prod(linear))))
    assert fit.is_better
    assert not fit._replace(linear_left_out=0.5 * own).is_better


@pytest.mark.slow
@pytest.mark.exhaustive
def test_start_whose_encoder_drifts___fit___simulates_to_the_noise() -> None:
    fit = _fitted(_record(12_000), orders=(6,))

    assert fit.friction.levels[0] == pytest.approx(LEVEL, rel=0.01)
    assert np.all(fit.error < 3.0 * 0.0015)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_command_that_acts_a_sample_late___fit___takes_the_order_that_it_needs() -> None:
    record = _record(12_000)
    late = replace(record, u=np.vstack([record.u[1:], np.zeros((1, 1))]))

    fit = _fitted(late, orders=range(4, 18, 2))

    assert fit.friction.levels[0] == pytest.approx(LEVEL, rel=0.01)
    assert np.all(fit.error < 3.0 * 0.0015)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_output_that_no_linear_model_has___fit___leaves_the_others_at_their_noise() -> None:
    record = _record(8000)
    bent = record.y[:, 1]
    y = record.y.copy()
    y[:, 1] += 0.2 * bent * np.abs(bent) / np.abs(bent).max()

    fit = _fitted(replace(record, y=y))

    assert fit.error[0] < 3.0 * 0.0015
    assert fit.error[1] > 0.01
    assert fit.friction.levels[0] == pytest.approx(LEVEL, rel=0.03)


def test_friction_of_a_drive___net_record___lacks_it_where_the_drive_slips() -> None:
    time_s = DT_S * np.arange(4000)
    hub, u = np.sin(2.0 * time_s), np.zeros((4000, 1))
    record = IoData(u, hub[:, np.newaxis], dt_s=DT_S, inputs=("u",), outputs=("hub",))
    one = np.array([0.3])
    estimate = CoulombEstimate((Drive("u", "hub"),), one, one, NONE, (4000,), (True,))

    net = net_record(record, estimate)

    slips = np.abs(np.cos(2.0 * time_s)) > 0.2
    slips[:200] = slips[-200:] = False
    np.testing.assert_allclose(net.u[slips, 0], -0.3 * np.sign(np.cos(2.0 * time_s[slips])))
    assert np.abs(net.u).max() <= 0.3


def test_arm_without_friction___fit___ends_with_the_first_prediction() -> None:
    record = _record(4000, level=0.0)
    start = identify(record, friction=False, method="pbsid", order=4)
    reported: list[float] = []

    fit = fit_joints(
        *(start.model, [[(start.model, start.x0[0])]], record, (Drive("torque", "encoder"),)),
        np.array([LEVEL]),
        progress=lambda _stage, part: reported.append(part),
    )

    assert fit is None
    assert not reported


def test_orders_without_a_start___fit___is_none() -> None:
    record = _record(4000)
    start = identify(record, friction=False, method="pbsid", order=4)

    assert fit_joints(start.model, [[], []], record, (Drive("torque", "encoder"),), NONE) is None


def test_coupled_joints___layout___pairs_each_motor_with_the_joint_that_it_accelerates() -> None:
    rng = np.random.default_rng(5)
    # The first motor moves the second joint faster than its own one.
    mass = np.array([[0.5, 0.2], [0.2, 0.1]])
    inverse = np.linalg.inv(mass)
    samples, q, v, goal = 8000, np.zeros(2), np.zeros(2), np.zeros(2)
    u, y = np.empty((samples, 2)), np.empty((samples, 3))
    bend = np.zeros(2)
    for k in range(samples):
        if k % 400 == 0:
            goal = rng.uniform(-0.5, 0.5, 2)
        y[k] = [*q, bend[0]]
        dither = np.array([0.3, 0.03]) * rng.standard_normal(2)
        u[k] = np.array([3.0, 0.3]) * (goal - q) - np.array([1.5, 0.1]) * v + dither
        bend += DT_S * np.array([bend[1], u[k, 0] - 3000.0 * bend[0] - 3.0 * bend[1]])
        v = v + DT_S * inverse @ u[k]
        q = q + DT_S * v
    data = IoData(u, y, dt_s=DT_S, inputs=("u1", "u2"), outputs=("q1", "q2", "bend"))

    found = joints([data])

    assert abs(inverse[1, 0]) > inverse[0, 0]
    assert found == (Drive("u1", "q1"), Drive("u2", "q2"))


def test_joints___hub_that_turns_freely___is_the_joint_of_its_torque() -> None:
    rng = np.random.default_rng(4)
    torque = rng.standard_normal((6000, 1))
    speed = scipy.signal.lfilter([DT_S], [1.0, -0.9999], torque, axis=0)
    hub = scipy.signal.lfilter([DT_S], [1.0, -0.9999], speed, axis=0)
    bend = scipy.signal.lfilter([1.0], [1.0, -1.5, 0.9], torque, axis=0)
    data = IoData(torque, np.hstack([hub, bend]), dt_s=DT_S, inputs=("u",), outputs=("hub", "bend"))

    assert joints([data]) == (Drive("u", "hub"),)
