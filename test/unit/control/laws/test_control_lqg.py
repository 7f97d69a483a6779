"""The LQG law: its design by scipy, its disturbance state, delay, payload and rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from flexarm_control import build_law, step_figures
from flexarm_control.design.regulator_tuning import RegulatorLoop
from flexarm_control.laws import ilqr, lqg
from flexarm_control.laws.ilqr import Ilqr
from flexarm_control.laws.law_protocol import Effort, hearing
from flexarm_control.laws.lqg import LqgWeights, design_lqg, packaged_designs
from flexarm_control.laws.regulator_loop import closed_loop
from flexarm_control.models.arm_model import delayed
from flexarm_control.models.nominal_models import identified_model, rig_model
from flexarm_control.simulation import simulate, simulate_loop
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.loop.limiter import Limiter, LimiterSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_core.arrays import FloatArray

WEIGHTS = LqgWeights(
    position=2.0, strain=0.1, speed=0.7, effort=0.4, disturbance_v=0.5, drift_v=0.02
)
LATE_S = 1.67e-3


def test_filter_and_regulator___are_the_solutions_of_their_riccati_equations() -> None:
    late = delayed(identified_model(), WEIGHTS.loop_delay_s)
    a, b, c = late.A, late.B, late.C
    noise = np.diag(np.square([0.09, 0.17, 0.17, 0.06]))

    design = design_lqg(identified_model(), WEIGHTS)

    q = c.T @ np.diag([2.0, 0.1, 0.1, 0.7]) @ c
    p = solve_discrete_are(a, b, q, np.array([[0.4]]))
    expected = np.linalg.solve(0.4 + b.T @ p @ b, b.T @ p @ a).ravel()
    np.testing.assert_allclose(design.kc, [*expected, 1.0], rtol=1e-5, atol=1e-8)
    # States of the arm with the command on its way, then the disturbance, which stays.
    a, c = np.block([[a, b], [np.zeros((1, 9)), 1.0]]), np.hstack([c, np.zeros((4, 1))])
    moved = np.zeros((10, 10))
    moved[:9, :9] = 0.25 * (b @ b.T + 1e-6 * np.eye(9))
    moved[9, 9] = 4e-4
    p = solve_discrete_are(a.T, c.T, moved, noise)
    expected = a @ p @ c.T @ np.linalg.inv(noise + c @ p @ c.T)
    np.testing.assert_allclose(design.observer, expected, rtol=1e-4, atol=1e-7)
    assert max(design.observer_radius, design.regulator_radius) < 1.0


@given(disturbance_v=st.floats(-0.5, 0.5), payload_kg=st.sampled_from([0.0, 0.2, 0.4]))
@settings(max_examples=6, deadline=None)
def test_constant_disturbance___is_found_and_taken_out(
    disturbance_v: float, payload_kg: float
) -> None:
    model = delayed(rig_model(payload_kg), 0.001)
    law, state = Ilqr(design_lqg(rig_model(payload_kg))), np.zeros(model.nstates)

    for _ in range(3000):
        answer = law.step((model.C @ state).tolist(), 2.0)
        state = model.A @ state + model.B[:, 0] * (answer.effort_v + disturbance_v)

    assert model.C[0] @ state == pytest.approx(2.0, abs=1e-4)
    assert law.memory()["observer"][-1] == pytest.approx(disturbance_v, abs=1e-4)
    assert answer.effort_v == pytest.approx(-disturbance_v, abs=1e-4)


def test_law___on_the_way___answers_as_its_linear_loop() -> None:
    model, reference_v = delayed(rig_model(0.2), 0.001), np.full(100, 1.0)
    law = build_law("lqg", {"payload_kg": 0.2, "compensation_v": 0.0, "detected_kg": 0.001})

    run = simulate_loop(model, law, reference_v)

    loop = closed_loop(design_lqg(rig_model(0.2)), model)
    expected = control.forced_response(loop, inputs=reference_v, timepts=run.time_s)
    np.testing.assert_allclose(run.y, expected.outputs.T, atol=1e-7)


@pytest.mark.parametrize("delay_s", [0.0, 5e-4, LATE_S])
def test_packaged_designs___keep_their_margins_with_and_without_delay(delay_s: float) -> None:
    designs = [each.design for each in packaged_designs(LqgWeights())]

    for payload_kg, design in zip((0.0, 0.2, 0.4), designs, strict=True):
        margins = RegulatorLoop(rig_model(payload_kg), delay_s=delay_s).margins(design)
        assert margins.stable
        assert margins.gain_margin_db >= 12.0
        assert margins.phase_margin_deg >= 50.0


@pytest.mark.parametrize(("payload_kg", "setpoint_v"), [(0.0, 1.0), (0.2, 5.0), (0.4, 3.0)])
def test_step___with_half_a_sample_of_delay___settles(payload_kg: float, setpoint_v: float) -> None:
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg, loop_delay_s=LATE_S), seed=7)

    run = simulate(rig, build_law("lqg"), np.full(1500, setpoint_v), true_outputs=rig.outputs_v)

    figures = step_figures(run.time_s, run.true_y[:, 0], setpoint_v)
    assert figures.settling_s <= 2.5
    assert figures.overshoot <= 0.12
    # The arm is at rest, and the help is less than the friction.
    assert np.abs(run.effort[1200:] + run.compensation[1200:]).max() <= 0.75
    assert np.ptp(run.true_y[1200:, 0]) <= 0.02


def test_payload___that_is_detected___chooses_the_design() -> None:
    law = build_law("lqg", {"payload_kg": 0.0})
    rig = SimulatedRig(RigParameters(payload_kg=0.4), seed=2)

    simulate(rig, law, np.full(600, 3.0))

    assert law.memory()["active"][0] == 2.0
    law.reset()
    assert law.memory()["active"][0] == 0.0


def test_compensation___grows_with_the_effort_and_has_its_sign() -> None:
    law = build_law("lqg", {"full_effort_v": 1.0, "compensation_v": 0.6})

    for reference_v in (0.2, -0.2, 5.0, -5.0):
        law.reset()
        effort_v, compensation_v = law.step((0.0,) * 4, reference_v)
        share = min(1.0, abs(effort_v))
        assert compensation_v == pytest.approx(0.6 * share * np.sign(effort_v))


def test_rest___forgets_the_disturbance() -> None:
    law = build_law("lqg", {"payload_kg": 0.2})
    simulate_loop(rig_model(0.2), law, np.full(60, 1.0))

    for _ in range(300):
        answer = law.step((1.0, 0.02, 0.0, 0.0), 1.0)

    memory = law.memory()
    assert memory["resting"][0]
    observers = np.reshape(memory["observers"], (3, -1))
    np.testing.assert_array_equal(observers[:, -1], 0.0)
    # The help of `pdpc_plus`: 0.55 V at 0.05 V of strain.
    assert answer.compensation_v == pytest.approx(-0.55 * 0.4, rel=1e-3)


@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("limit", [{"max_command_v": 2.0}, {"max_slew_v_per_s": 50.0}])
def test_command_that_the_gate_cuts___is_heard_of(
    payload_kg: float, limit: dict[str, float]
) -> None:
    """A law that does not hear it overshoots by 14 to 22 % at 2 V, and by 7 to 11 % at 50 V/s."""
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg), seed=1)
    gate, law = Limiter(LimiterSettings(**limit).limits()), build_law("lqg")

    def acting_v(answer: Effort) -> float:
        return gate.apply(*answer, position=0.0, interval_s=1.0 / 300.0).command

    run = simulate(rig, law, np.full(1500, 3.0), acting_v=acting_v)

    assert step_figures(run.time_s, run.y[:, 0], 3.0).overshoot < 0.06


@pytest.mark.parametrize(("name", "apart_v"), [("lqg", 1e-9), ("ilqr", 0.02)])
@pytest.mark.parametrize("payload_kg", [0.0, 0.1, 0.4])
def test_law_behind_a_gate___moves_the_arm_as_one_that_knows_the_limit(
    name: str, apart_v: float, payload_kg: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sum of errors hears of a cut a sample later, and an observer of all of it in time."""
    limit_v = 2.0

    def within(effort_v: float, compensation_v: float = 0.0) -> Effort:
        command_v = min(limit_v, max(-limit_v, effort_v + compensation_v))
        return Effort(command_v - compensation_v, compensation_v)

    def moved(acting_v: Callable[[Effort], float]) -> FloatArray:
        rig = SimulatedRig(RigParameters(payload_kg=payload_kg), seed=1)
        return simulate(rig, build_law(name), np.full(900, 3.0), acting_v=acting_v).y[:, 0]

    behind_v = moved(lambda answer: sum(within(*answer)))
    for module in (lqg, ilqr):
        monkeypatch.setattr(module, "limited", within)

    np.testing.assert_allclose(behind_v, moved(sum), atol=apart_v)


def test_effort_that_was_not_sent___is_heard_by_every_observer() -> None:
    law, other = build_law("lqg"), build_law("lqg")
    for each in (law, other):
        each.step((0.0,) * 4, 3.0)

    hearing(law)(-2.0, 2.0)

    designs = packaged_designs(LqgWeights())
    moved = np.reshape(np.subtract(law.memory()["observers"], other.memory()["observers"]), (3, -1))
    expected = [-2.0 * np.ravel(each.design.model.B) for each in designs]
    np.testing.assert_allclose(moved, expected, atol=1e-12)
