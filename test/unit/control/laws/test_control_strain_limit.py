"""Prediction of the gauge by stepping the loop, and the limit on the simulated rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control import build_law
from flexarm_control.laws.lqg import design_lqg
from flexarm_control.laws.strain_limit import StrainLimiter, predictions
from flexarm_control.models.arm_model import BASE_STRAIN
from flexarm_control.models.nominal_models import rig_model
from flexarm_control.simulation import simulate
from flexarm_daq import RigParameters, SimulatedRig
from support.exhaustive import first_of

if TYPE_CHECKING:
    from flexarm_control.laws.ilqr import IlqrDesign


def limiter_of(design: IlqrDesign, limit_v: float) -> StrainLimiter:
    """Return the limiter of a design."""
    return StrainLimiter(design.model, design.kc, design.kp, limit_v)


def test_predictions___are_those_of_the_loop_sample_by_sample() -> None:
    design = design_lqg(rig_model(0.2))
    from_state, from_reference, from_corrections = predictions(design.model, design.kc, design.kp)
    samples, corrections = from_corrections.shape
    draw = np.random.default_rng(0)
    state, corrections_v, reference_v = draw.normal(size=10), draw.normal(size=corrections), 2.0

    found = from_state @ state + from_reference * reference_v + from_corrections @ corrections_v

    expected = []
    for correction_v in np.repeat(corrections_v, samples // corrections):
        effort_v = design.kp * reference_v - design.kc @ state + correction_v
        state = design.model.A @ state + design.model.B[:, 0] * effort_v
        expected.append(design.model.C[BASE_STRAIN] @ state)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_effort___is_kept_below_the_limit_and_lessened_beyond_it() -> None:
    design = design_lqg(rig_model(0.2))
    at_rest = np.zeros(design.model.nstates)

    assert limiter_of(design, 20.0).limited_v(1.5, at_rest, 0.0, 1.0) == 1.5
    # Bent more than the model knows: that counts too.
    assert limiter_of(design, 20.0).limited_v(1.5, at_rest, 40.0, 1.0) < 1.5
    for reference_v in (3.0, 5.0):
        limiter, effort_v = limiter_of(design, 1.0), design.kp * reference_v
        forward_v = limiter.limited_v(effort_v, at_rest, 0.0, reference_v)
        backward_v = limiter.limited_v(-effort_v, at_rest, 0.0, -reference_v)
        assert backward_v == pytest.approx(-forward_v)
        assert 0.0 < forward_v < effort_v


@pytest.mark.parametrize("effort_v", [-4.0, -0.5, 0.0, 0.5, 4.0])
@pytest.mark.parametrize("base_v", [-8.0, 8.0])
def test_effort___however_bent_the_arm___is_never_reversed(effort_v: float, base_v: float) -> None:
    design = design_lqg(rig_model(0.0))
    at_rest = np.zeros(design.model.nstates)
    found_v = limiter_of(design, 0.5).limited_v(effort_v, at_rest, base_v, 0.0)
    assert min(0.0, effort_v) <= found_v <= max(0.0, effort_v)


def test_corrections___on_the_model___keep_the_gauge_at_the_limit() -> None:
    """The loop of the model alone, which the predictions describe."""
    design = design_lqg(rig_model(0.2))
    limiter, state, gauge_v = limiter_of(design, 2.0), np.zeros(design.model.nstates), []

    for _ in range(900):
        gauge_v.append(float(design.model.C[BASE_STRAIN] @ state))
        free_v = float(design.kp * 5.0 - design.kc @ state)
        effort_v = limiter.limited_v(free_v, state, gauge_v[-1], 5.0)
        state = design.model.A @ state + design.model.B[:, 0] * effort_v

    assert 0.5 * 2.0 <= np.abs(gauge_v).max() <= 2.0
    assert design.model.C[0] @ state == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize(("payload_kg", "setpoint_v"), [(0.0, 5.0), (0.4, 5.0)])
def test_limit___on_the_rig___is_kept_softly(payload_kg: float, setpoint_v: float) -> None:
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg, loop_delay_s=1.67e-3), seed=1)
    law = build_law("lqg", {"strain_limit_v": 2.0})

    run = simulate(rig, law, np.full(1200, setpoint_v), true_outputs=rig.outputs_v)

    assert np.abs(run.true_y[:, BASE_STRAIN]).max() <= 1.5 * 2.0
    assert run.true_y[-1, 0] == pytest.approx(setpoint_v, abs=0.05 * setpoint_v)


# Payload, set-point before and after, limit, seed, samples until the set-point is reversed: with
# corrections that might reverse the effort, all of these swung for ever between the drive's stops.
_REVERSALS = [
    (0.1, 2.0, 3.0, 40, 41),
    (0.1, 4.0, 4.0, 23, 77),
    (0.1, 4.0, 1.5, 31, 233),
    (0.1, 5.0, 2.0, 88, 55),
    (0.2, 2.0, 1.5, 91, 47),
]


@pytest.mark.parametrize(
    ("payload_kg", "amplitude_v", "limit_v", "seed", "moved"), first_of(_REVERSALS, 2)
)
def test_limit___of_a_move_that_is_reversed_on_its_way___comes_to_rest(
    payload_kg: float, amplitude_v: float, limit_v: float, seed: int, moved: int
) -> None:
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg), seed=seed)
    law = build_law("lqg", {"strain_limit_v": limit_v})
    reference_v = np.concatenate(
        [np.zeros(30), np.full(moved, amplitude_v), np.full(1800, -amplitude_v)]
    )

    run = simulate(rig, law, reference_v, true_outputs=rig.outputs_v)

    late = run.true_y[-600:]
    np.testing.assert_allclose(late[:, 0], -amplitude_v, atol=0.25)
    assert np.std(late[:, BASE_STRAIN]) < 0.2
    assert np.abs(run.effort[-600:]).max() < 2.0
