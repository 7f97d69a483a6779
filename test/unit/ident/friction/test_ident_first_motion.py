"""Initial states under dry friction: found from the record, and the errors of a model of a file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_ident import IdentificationError, IoData, validate_dmv, validate_with_friction
from flexarm_ident.friction.dry_friction import DryFriction, simulate_with_friction
from support.ident_systems import DT_S, named

NOTHING = np.zeros(1)
FRICTION = DryFriction(np.array([0.4]), NOTHING, NOTHING, NOTHING, np.array([[0.0, 1.0]]))
SLEDGE = named(
    np.array([[1.0, DT_S], [0.0, 1.0 - DT_S]]),
    np.array([[0.5 * DT_S**2], [DT_S]]),
    np.eye(2),
    np.zeros((2, 1)),
)


def moved(x0: tuple[float, float], seed: int = 0) -> IoData:
    """Return a sledge with friction that begins in motion."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2.0, 2.0, 30), 100)[:, np.newaxis]
    y, _ = simulate_with_friction(SLEDGE, FRICTION, u, np.array(x0))
    noise = 0.01 * rng.normal(size=y.shape)
    labels = tuple(SLEDGE.input_labels), tuple(SLEDGE.output_labels)
    return IoData(u, y + noise, dt_s=DT_S, inputs=labels[0], outputs=labels[1])


@pytest.mark.parametrize("x0", [(0.0, 0.0), (0.7, -0.8), (-3.0, 1.5)])
def test_validation___friction_and_unknown_first_motion___finds_it(
    x0: tuple[float, float],
) -> None:
    record = moved(x0)
    known = validate_with_friction(SLEDGE, FRICTION, record, np.array(x0))
    found = validate_with_friction(SLEDGE, FRICTION, record)
    assert found.x0 == pytest.approx(x0, abs=0.02)
    assert found.mean <= 1.05 * known.mean
    assert validate_dmv(SLEDGE, record).mean > 5.0 * found.mean


def test_validation___sensor_that_is_dead_at_first___leaves_its_state_at_rest() -> None:
    # A load that nothing drives, behind a sensor of its own.
    A, C = np.diag([0.0, 0.0, 0.9]), np.eye(3)
    A[:2, :2], B = SLEDGE.A, np.vstack([SLEDGE.B, [[0.05]]])
    model = named(A, B, C, np.zeros((3, 1)))
    friction = replace(FRICTION, speed=np.array([[0.0, 1.0, 0.0]]))
    u = moved((0.0, 0.0)).u
    y, _ = simulate_with_friction(model, friction, u, np.zeros(3))
    y[:200, 2] = 3.0
    noise = 0.002 * np.random.default_rng(1).normal(size=y.shape)
    noise[:200, 2] = 0.0
    names = tuple(model.input_labels), tuple(model.output_labels)
    record = IoData(u, y + noise, dt_s=DT_S, inputs=names[0], outputs=names[1])
    found = validate_with_friction(model, friction, record)
    assert found.x0[2] == pytest.approx(0.0, abs=1e-3)


def test_validation___friction_and_another_period___is_refused() -> None:
    record = replace(moved((0.0, 0.0)), dt_s=2.0 * DT_S)
    with pytest.raises(IdentificationError, match="period"):
        validate_with_friction(SLEDGE, FRICTION, record)
