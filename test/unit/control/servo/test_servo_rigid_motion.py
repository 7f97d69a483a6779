"""Rigid motion and friction of a record against the arm that made it."""

from __future__ import annotations

import control
import numpy as np
import pytest

from flexarm_control.servo.job import Source, with_rigid_motion
from flexarm_control.servo.rigid_motion import rigid_motion
from flexarm_ident.friction.dry_friction import DryFriction, simulate_with_friction
from flexarm_ident.records.iodata import IoData
from support.servo_plants import DT_S, bending_arm

LEVEL, SAMPLES = 0.06, 10_000
_SPEED = np.array([[0.0, 1.0, 0.0, 0.0]])


def _friction(level: float) -> DryFriction:
    none = np.zeros(1)
    return DryFriction(np.array([level]), none, none, none, _SPEED)


@pytest.fixture(scope="module")
def record() -> IoData:
    """Return a record of the arm with friction, driven to and fro, with the noise of an encoder."""
    rng = np.random.default_rng(4)
    u = 0.12 * np.repeat(rng.choice([-1.0, 1.0], SAMPLES // 400), 400)
    u = (u + 0.02 * rng.standard_normal(SAMPLES))[:, None]
    y, _ = simulate_with_friction(bending_arm(), _friction(LEVEL), u, np.zeros(4))
    y += rng.standard_normal(y.shape) * [1e-4, 1e-5]
    return IoData(u, y, dt_s=DT_S, inputs=("torque",), outputs=("hub", "bend"))


@pytest.fixture(scope="module")
def imitation() -> control.StateSpace:
    """Return the arm with two slow poles that hold the hub, as a fit without friction has them."""
    model = bending_arm()
    A = np.array(model.A)
    A[:2, :2] = [[0.999, 1e-3], [0.0, 0.98]]
    return control.StateSpace(
        A, model.B, model.C, 0.0, DT_S, inputs=["torque"], outputs=["hub", "bend"]
    )


def test_rigid_motion___arm_with_friction___is_that_of_the_arm(
    record: IoData, imitation: control.StateSpace
) -> None:
    found = rigid_motion(imitation, record, [0])

    assert found is not None
    assert found.friction.levels[0] == pytest.approx(LEVEL, rel=0.1)
    assert found.error < 0.3 * found.former_error
    # Below the vibration, as the arm without friction.
    for frequency_hz in (0.5, 1.0, 2.0):
        z = np.exp(2j * np.pi * frequency_hz * DT_S)
        ours, true = (each(z)[0, 0] for each in (found.model, bending_arm()))
        assert abs(ours / true - 1.0) < 0.1


def test_rigid_motion___pair_slower_than_the_record___is_no_vibration(
    record: IoData, imitation: control.StateSpace
) -> None:
    slow = 2.0 * np.pi / (2.0 * SAMPLES)
    turn = [[np.cos(slow), -np.sin(slow)], [np.sin(slow), np.cos(slow)]]
    pair = control.StateSpace(turn, [[1e-6], [0.0]], np.eye(2), 0.0, DT_S)

    found = rigid_motion(imitation + pair, record, [0])

    assert found is not None
    assert found.model.nstates == bending_arm().nstates
    assert found.friction.levels[0] == pytest.approx(LEVEL, rel=0.1)


def test_rigid_motion___model_that_is_right___stays(record: IoData) -> None:
    u = record.u
    y, _ = simulate_with_friction(bending_arm(), _friction(0.0), u, np.zeros(4))
    frictionless = IoData(u, y, dt_s=DT_S, inputs=("torque",), outputs=("hub", "bend"))

    assert rigid_motion(bending_arm(), frictionless, [0]) is None


def test_rigid_motion___plant_without_a_vibration___stays(record: IoData) -> None:
    lag = control.StateSpace([[0.99]], [[0.1]], [[1.0], [0.5]], 0.0, DT_S)

    assert rigid_motion(lag, record, [0]) is None


def test_with_rigid_motion___friction_in_the_file___stays(
    record: IoData, imitation: control.StateSpace
) -> None:
    source = Source("arm", imitation, _friction(0.05), record)

    assert with_rigid_motion(source, (0,)) == (source, ())


def test_with_rigid_motion___better___says_it(
    record: IoData, imitation: control.StateSpace
) -> None:
    source, (note,) = with_rigid_motion(Source("arm", imitation, None, record), (0,))

    assert source.friction is not None
    assert "torque" in note
