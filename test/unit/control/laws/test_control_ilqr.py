"""The ILQR controller: its design by independent routes, and its runs on the simulated rig."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from flexarm_control.design.criteria import step_figures
from flexarm_control.laws.ilqr import Ilqr, IlqrWeights, design_ilqr
from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.lqg import design_lqg
from flexarm_control.laws.registry import build_law
from flexarm_control.laws.switching import Handover
from flexarm_control.models.nominal_models import identified_model, nominal_model
from flexarm_control.simulation import simulate
from flexarm_core.errors import SettingError
from flexarm_daq import RigParameters, SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Callable

RATE_HZ = 300.0
WEIGHTS = IlqrWeights(position=2.0, strain=0.1, speed=0.5, effort=3.0, ki=0.001)


# The last are those of section 4.4.
@pytest.mark.parametrize("states", [(0.0,), (0.02,), (2.0, 0.4, 0.4, 0.1, *4 * (0.04,))])
def test_regulator___is_the_solution_of_the_riccati_equation(states: tuple[float, ...]) -> None:
    model = identified_model()
    design = design_ilqr(model, replace(WEIGHTS, states=states))
    a, b, c = model.A, model.B, model.C
    q = c.T @ np.diag([2.0, 0.1, 0.1, 0.5]) @ c + np.eye(model.nstates) * states

    p = solve_discrete_are(a, b, q, np.array([[3.0]]))

    expected = np.linalg.solve(3.0 + b.T @ p @ b, b.T @ p @ a)
    np.testing.assert_allclose(design.kc, expected.ravel(), rtol=1e-6, atol=1e-9)
    eigenvalues = np.linalg.eigvals(a - b @ expected)
    assert design.regulator_radius == pytest.approx(np.abs(eigenvalues).max(), abs=1e-9)
    assert max(design.regulator_radius, design.observer_radius) < 1.0


@pytest.mark.parametrize("observer_speed", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4, None])
def test_observer___is_as_much_faster_as_asked_for(
    payload_kg: float | None, observer_speed: float
) -> None:
    model = identified_model() if payload_kg is None else nominal_model(payload_kg)

    design = design_ilqr(model, IlqrWeights(observer_speed=observer_speed))

    # Magnitude to the power of the samples is what is left of an error.
    errors = np.linalg.eigvals(model.A - design.observer @ model.C[[0]])
    assert np.abs(errors).max() == pytest.approx(design.observer_radius)
    assert design.observer_radius <= design.regulator_radius**observer_speed + 1e-9


def test_observer___of_no_least_speed___is_the_regulator_of_the_dual_system() -> None:
    model = identified_model()

    design = design_ilqr(model, IlqrWeights(observer_speed=0.0))

    # As the thesis has it, with Q = I and R = 1.
    c = model.C[[0]]
    p = solve_discrete_are(model.A.T, c.T, np.eye(model.nstates), np.eye(1))
    expected = model.A @ p @ c.T / (1.0 + c @ p @ c.T)
    np.testing.assert_allclose(design.observer, expected, rtol=1e-6, atol=1e-9)


def test_weights_of_states___of_another_number___are_refused() -> None:
    with pytest.raises(SettingError, match=r"2 weights and the model 8 states"):
        design_ilqr(identified_model(), IlqrWeights(states=(1.0, 2.0)))
    with pytest.raises(SettingError, match=r"states = -1 is outside 0 to 1000"):
        IlqrWeights(states=(1.0, -1.0))


def test_start___where_the_arm_rests___moves_nothing() -> None:
    model = identified_model()
    law = Ilqr(design_ilqr(model, IlqrWeights(ki=0.0)))
    held = np.linalg.solve(np.eye(model.nstates) - model.A, model.B[:, 0])
    state = 2.0 * held / (model.C[0] @ held)
    needed_v = float(np.mean(np.linalg.lstsq(model.B, state - model.A @ state, rcond=None)[0]))

    for _ in range(100):
        effort = law.step((model.C @ state).tolist(), 2.0)
        assert effort.effort_v == pytest.approx(needed_v, abs=1e-6)


def test_measurement_that_is_none___is_answered_with_zero_and_forgotten() -> None:
    law, other = Ilqr(design_ilqr(identified_model())), Ilqr(design_ilqr(identified_model()))
    for k in range(10):
        law.step((0.1 * k, 0.0, 0.0, 0.0), 3.0)
        other.step((0.1 * k, 0.0, 0.0, 0.0), 3.0)

    assert law.step((1e300, 0.0, 0.0, 0.0), 3.0) == (0.0, 0.0)

    expected = other.step((1.0, 0.0, 0.0, 0.0), 3.0)
    assert law.step((1.0, 0.0, 0.0, 0.0), 3.0) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("design", [design_ilqr, design_lqg])
def test_weights_without_a_solution___are_refused_in_one_line(
    design: Callable[[control.StateSpace], object],
) -> None:
    model = identified_model()
    # A mode on the unit circle that neither input nor output knows.
    a = np.block([[model.A, np.zeros((8, 1))], [np.zeros((1, 8)), np.ones((1, 1))]])
    lost = control.StateSpace(
        a, np.vstack([model.B, [[0.0]]]), np.hstack([model.C, np.zeros((4, 1))]), 0.0, model.dt
    )

    with pytest.raises(SettingError, match=r"no regulator or observer[^\n]*$"):
        design(lost)


def test_weights_without_the_position___are_refused_in_one_line() -> None:
    with pytest.raises(SettingError, match=r"no regulator or observer[^\n]*weigh the position"):
        build_law("lqg", {"position": 0.0})


def test_reference_gain___brings_the_model_to_the_set_point() -> None:
    model = identified_model()
    design = design_ilqr(model, IlqrWeights(ki=0.0))
    law, state = Ilqr(design), np.zeros(model.nstates)

    for _ in range(6000):
        volts = (model.C @ state).tolist()
        state = model.A @ state + model.B[:, 0] * law.step(volts, 2.0).effort_v

    assert model.C[0] @ state == pytest.approx(2.0, abs=1e-6)


def test_integral___takes_out_a_constant_disturbance() -> None:
    model = identified_model()
    law, state = Ilqr(design_ilqr(model)), np.zeros(model.nstates)

    for _ in range(20000):
        volts = (model.C @ state).tolist()
        state = model.A @ state + model.B[:, 0] * (law.step(volts, 2.0).effort_v - 0.3)

    assert model.C[0] @ state == pytest.approx(2.0, abs=1e-3)


def test_model_without_the_outputs_of_the_arm___is_refused() -> None:
    model = nominal_model(0.2)
    with pytest.raises(SettingError):
        design_ilqr(model[:2, :])


def test_reset___forgets_the_past() -> None:
    law = Ilqr(design_ilqr(identified_model()))
    first = [law.step((0.1 * k, 0.0, 0.0, 0.0), 3.0) for k in range(20)]

    law.reset()

    again = [law.step((0.1 * k, 0.0, 0.0, 0.0), 3.0) for k in range(20)]
    np.testing.assert_allclose(again, first, rtol=1e-9)


@pytest.mark.parametrize(("setpoint_v", "hunts"), [(3.0, False), (5.0, True)])
def test_friction___is_held_while_it_is_constant_and_not_when_it_reverses(
    setpoint_v: float, *, hunts: bool
) -> None:
    """Section 4.4: 3 V at 300 g is well, at 5 V the arm overshoots, reverses and hunts."""
    rig = SimulatedRig(RigParameters(payload_kg=0.3), seed=1)
    law = Ilqr(design_ilqr(identified_model()))

    run = simulate(rig, law, np.full(round(20.0 * RATE_HZ), setpoint_v))

    position_v = run.y[:, 0]
    figures = step_figures(run.time_s, position_v, setpoint_v)
    swing_v = np.ptp(position_v[round(10.0 * RATE_HZ) :])
    assert (figures.overshoot >= 0.08) is hunts
    assert bool(swing_v >= 0.2) is hunts
    if not hunts:
        assert figures.overshoot <= 0.06
        assert swing_v <= 0.05


@pytest.mark.parametrize(("limit_v", "first_v"), [(1.0, 3.0), (100.0, 60.0)])
def test_observer_of_an_exact_model___that_hears_what_was_sent___is_the_state_of_the_arm(
    limit_v: float, first_v: float
) -> None:
    """Behind a limit of the gate, and at 100 V behind the law's own 10 V."""
    model = identified_model()
    design = design_ilqr(model, IlqrWeights(ki=0.0))
    law, state = Handover(Ilqr(design)), np.zeros(model.nstates)
    drive, cut = DriveCommand(0.0, 0.0), []

    for k in range(1500):
        reference_v = first_v if k < 30 else 2.0
        wanted_v = design.kp * reference_v - float(design.kc @ state)
        answer = law.step((model.C @ state).tolist(), reference_v, drive)
        assert answer.effort_v == pytest.approx(min(max(wanted_v, -10.0), 10.0), abs=1e-5)
        sent_v = min(max(answer.effort_v, -limit_v), limit_v)
        cut.append(abs(wanted_v) > min(limit_v, 10.0))
        drive = DriveCommand(sent_v, 0.0)
        state = model.A @ state + model.B[:, 0] * sent_v

    # What is not cut shows whether the observer knows of what was.
    assert min(sum(cut), len(cut) - sum(cut)) > 10


@pytest.mark.parametrize(("error_v", "sums"), [(0.5, False), (-0.5, True)])
@pytest.mark.parametrize("cut", ["here", "by the gate"])
def test_sum_of_errors___while_a_limit_cuts_the_effort___takes_those_that_lead_out_of_it(
    error_v: float, cut: str, *, sums: bool
) -> None:
    design = design_ilqr(identified_model(), IlqrWeights(ki=0.01))
    law = Ilqr(design)
    wanted_v = 20.0 if cut == "here" else 1.0
    at_v = -wanted_v * design.kc / (design.kc @ design.kc)
    law.remember({"observer": at_v.tolist(), "integral_v": [3.0], "started": [1.0]})

    if cut == "by the gate":
        law.hear(-0.8, 0.8)
    answer = law.step((-error_v, 0.0, 0.0, 0.0), 0.0)

    assert answer.effort_v > 0.9
    assert law.memory()["integral_v"] == pytest.approx([3.0 + error_v if sums else 3.0])
