"""Plants for servos: an arm that bends and two joints, in closed form."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import control
import numpy as np

from flexarm_control.servo.job import Source
from flexarm_ident.friction.dry_friction import load_friction
from flexarm_ident.models.files import load_model, load_parameters

if TYPE_CHECKING:
    from collections.abc import Sequence

DT_S = 0.002


def sampled(
    A: Sequence[Sequence[float]],
    B: Sequence[Sequence[float]],
    C: Sequence[Sequence[float]],
    D: Sequence[Sequence[float]] | float = 0.0,
    dt_s: float = DT_S,
    **names: Sequence[str],
) -> control.StateSpace:
    """Return a plant with held inputs, by default at 500 Hz."""
    found = control.c2d(control.StateSpace(A, B, C, D), dt_s)
    return control.StateSpace(found.A, found.B, found.C, found.D, dt_s, **names)


def bending_arm(outputs: int = 2, dt_s: float = DT_S) -> control.StateSpace:
    """Return a hub with viscous friction at .5 rad/s and one vibration of 8 Hz, 1 % damped."""
    speed = 2.0 * math.pi * 8.0
    A = np.zeros((4, 4))
    A[0, 1], A[1, 1] = 1.0, -0.5
    A[2, 3], A[3, 2], A[3, 3] = 1.0, -(speed**2), -0.02 * speed
    C = [[1.0, 0.0, 0.8, 0.0], [0.0, 0.0, 1.0, 0.0]][:outputs]
    # Two rigid forces on the bending: at rest it is bent by none, as a free hub gives way.
    B = [[0.0], [20.0], [0.0], [60.0]]
    model = sampled(A.tolist(), B, C, dt_s=dt_s)
    free = np.array(model.C)
    if outputs > 1:
        free[1] -= _static(model)[1] / _speed_gain(model) * np.array([0.0, 1.0, 0.0, 0.0])
    return control.StateSpace(
        model.A,
        model.B,
        free,
        0.0,
        dt_s,
        inputs=["torque"],
        outputs=["hub", "bend"][:outputs],
    )


def two_joints(dt_s: float = DT_S) -> control.StateSpace:
    """Return two coupled joints with viscous friction, each with its own motor."""
    inertia = np.array([[0.1, 0.03], [0.03, 0.05]])
    push = np.linalg.inv(inertia)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.zeros((2, 2)), -push @ np.diag([0.02, 0.01])]])
    B = np.vstack([np.zeros((2, 2)), push])
    C = np.hstack([np.eye(2), np.zeros((2, 2))])
    return sampled(
        A.tolist(),
        B.tolist(),
        C.tolist(),
        dt_s=dt_s,
        inputs=["torque1", "torque2"],
        outputs=["hub1", "hub2"],
    )


def measured_arm() -> Source:
    """Return the packaged model of the measured arm with two flexible links, with its friction."""
    file = Path(str(files("flexarm_control.models"))) / "identified" / "quanser_2dsfl.yaml"
    facts = {key.rpartition(".")[2]: value for key, value in load_parameters(file).items()}
    return Source("arm", load_model(file), load_friction(file), facts=facts)


def _static(model: control.StateSpace) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return what a constant input bends, apart from the hub that runs away."""
    bending = np.linalg.solve(np.eye(2) - model.A[2:, 2:], model.B[2:, 0])
    return np.asarray(model.C[:, 2:] @ bending)


def _speed_gain(model: control.StateSpace) -> float:
    """Return the speed that a constant input gives."""
    return float(model.B[1, 0] / (1.0 - model.A[1, 1]))
