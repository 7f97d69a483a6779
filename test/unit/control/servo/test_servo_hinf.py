"""Law hinf: its largest gain is the bound, and with an infinite one it is the servo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.linalg import block_diag

from flexarm_control.servo.controller import Servo
from flexarm_control.servo.generalised_plant import (
    GeneralisedPlant,
    hinf_gains,
    lqg_gains,
    smallest_bound,
    within,
)
from flexarm_control.servo.job import ServoRequest, Source, design_servo
from flexarm_control.servo.regulator import FILTERS, LAWS, _generalised, loop_plant
from flexarm_ident.models.state_space import simulate
from support.exhaustive import first_of
from support.servo_plants import bending_arm, two_joints

if TYPE_CHECKING:
    from flexarm_control.servo.generalised_plant import Gains
    from flexarm_control.servo.job import ServoDesign
    from flexarm_core.arrays import FloatArray

MODELS = {"arm": (bending_arm(), (0,)), "joints": (two_joints(), (0, 1))}


@pytest.fixture(params=MODELS)
def plant(request: pytest.FixtureRequest) -> GeneralisedPlant:
    model, tracked = MODELS[request.param]
    return _generalised(loop_plant(model), tracked, 1.0, np.ones(model.ninputs), FILTERS[0])


def largest_gain(plant: GeneralisedPlant, gains: Gains) -> float:
    """Return the largest gain from all noise to all costs of a loop, by its responses."""
    count, order, inputs = len(plant.A), len(plant.cost), plant.B.shape[1]
    corrected = np.eye(count) - gains.correction @ plant.C
    kept = gains.deviation - plant.B @ gains.feedback
    seen = -gains.feedback @ gains.correction
    A = np.block(
        [
            [plant.A + plant.B @ seen @ plant.C, -plant.B @ gains.feedback @ corrected],
            [kept @ gains.correction @ plant.C, kept @ corrected],
        ]
    )
    assert np.abs(np.linalg.eigvals(A)).max() < 1.0 + 1e-9
    noise = np.diag(plant.sizes)
    B = block_diag(_root(plant.noise), kept @ gains.correction @ noise)
    B[:count, count:] = plant.B @ seen @ noise
    effort = np.sqrt(plant.effort)
    C = np.zeros((order + inputs, 2 * count))
    C[:order, :order] = _root(plant.cost).T
    C[order:, :count] = effort @ seen @ plant.C
    C[order:, order:count] += effort @ plant.rejection
    C[order:, count:] = -effort @ gains.feedback @ corrected
    D = np.zeros((len(C), B.shape[1]))
    D[order:, count:] = effort @ seen @ noise
    peaks = np.angle(np.linalg.eigvals(A))
    around = np.ravel(peaks[peaks > 0.0][:, None] * np.linspace(0.8, 1.2, 81))
    z = np.exp(1j * np.concatenate([np.geomspace(1e-4, np.pi, 1000), around]))
    response = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B + 0j) + D
    return float(np.linalg.svd(response, compute_uv=False).max())


def _root(matrix: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def test_within___infinite_bound___is_the_servo(plant: GeneralisedPlant) -> None:
    found = within(plant, 1e5)

    assert found is not None
    for one, other in zip(found, lqg_gains(plant), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-7 * np.abs(other).max())


def test_within___smallest_bound___is_the_largest_gain(plant: GeneralisedPlant) -> None:
    least = smallest_bound(plant)
    near, far = within(plant, 1.03 * least), hinf_gains(plant)

    assert near is not None
    assert within(plant, 0.95 * least) is None
    # Near the smallest bound the central controller uses it up; no controller is below.
    assert largest_gain(plant, near) == pytest.approx(1.03 * least, rel=0.01)
    assert 0.97 * least < largest_gain(plant, far) < 1.3 * least
    assert largest_gain(plant, lqg_gains(plant)) > 1.3 * least


@pytest.mark.parametrize("name", first_of(MODELS))
def test_design_servo___hinf___rests_on_its_set_points_with_more_margin(name: str) -> None:
    servo, hinf = (_designed(name, law) for law in LAWS)

    for result in hinf.results:
        assert result.overshoot < 0.02
        assert result.settling_s < 3.0
        assert result.steady_error == pytest.approx(0.0, abs=1e-3)
    margins = [each.choice.margins[name].disk for each in (servo, hinf)]
    assert margins[1] > 1.1 * margins[0]


def test_step___hinf_at_its_set_point___is_the_linear_controller() -> None:
    design = _designed("joints", "hinf")
    y = 1e-4 * np.random.default_rng(0).standard_normal((200, 2))
    y[0] = 0.0
    servo = Servo(design.gains)

    commands = [servo.step(row, [0.0, 0.0]) for row in y]

    assert np.abs(commands).max() < 3.0
    expected = simulate(design.choice.regulator.controller, y)
    np.testing.assert_allclose(commands, expected, rtol=1e-6, atol=1e-9)


def _designed(name: str, law: str) -> ServoDesign:
    model, tracked = MODELS[name]
    outputs = tuple(model.output_labels[each] for each in tracked)
    limits = dict.fromkeys(model.input_labels, 3.0)
    request = ServoRequest(outputs, limits, bandwidth_hz=1.0, law=law)
    return design_servo([Source(name, model)], request)
