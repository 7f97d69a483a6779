"""The law planned: its moves on the simulated rig, changes on the way, payload, model, memory."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control import build_law, step_figures
from flexarm_control.laws.planned import Planned
from flexarm_control.laws.switching import Handover
from flexarm_control.models.nominal_models import identified_model
from flexarm_control.planning.flat_arm import ArmFigures
from flexarm_control.simulation import simulate
from flexarm_core.errors import SettingError
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_ident.models.state_space import state_space

if TYPE_CHECKING:
    from flexarm_control import Law, LoopRun
    from flexarm_control.laws.law_protocol import Effort

RATE_HZ = 300.0
AT_REST = (0.0, 0.0, 0.0, 0.0)


def run(law: Law, reference_v: np.ndarray, rig: RigParameters | None = None) -> LoopRun:
    """Run a law on the simulated rig; the true outputs are without noise."""
    arm = SimulatedRig(rig or RigParameters(), seed=3)
    return simulate(arm, law, reference_v, true_outputs=arm.outputs_v)


def constant(setpoint_v: float, length_s: float) -> np.ndarray:
    """Return the samples of a set-point."""
    return np.full(round(length_s * RATE_HZ), setpoint_v)


def planned(**values: float) -> Planned:
    """Return the law."""
    law = build_law("planned", values)
    assert isinstance(law, Planned)
    return law


@pytest.mark.parametrize("setpoint_v", [1.0, -3.0, 5.0])
def test_move___from_rest_to_rest___is_fast_exact_and_still(setpoint_v: float) -> None:
    made = run(planned(), constant(setpoint_v, 2.5))

    figures = step_figures(made.time_s, made.true_y[:, 0], setpoint_v)
    assert figures.settling_s <= 1.0
    assert figures.overshoot <= 0.06
    assert abs(figures.mean_error_v) <= 0.1
    assert abs(setpoint_v - made.true_y[-1, 0]) <= 0.03
    assert np.abs(made.command_v).max() <= 7.5
    # After a second the gauge is within its noise, 0.05 V.
    assert np.std(made.true_y[made.time_s > 1.0, 1]) <= 0.05


def test_first_answers___at_the_set_point_or_away___do_not_bump() -> None:
    law = planned()
    assert law.step((2.0, 0.0, 0.0, 0.0), 2.0).effort_v == 0.0

    law.reset()
    assert abs(sum(law.step(AT_REST, 3.0))) <= 0.2


def test_set_point___changed_on_the_way___is_reached_without_a_stop() -> None:
    reference_v = np.concatenate([constant(3.0, 0.25), constant(-1.0, 2.25)])

    made = run(planned(), reference_v)

    after = made.time_s >= 0.25
    figures = step_figures(made.time_s[after], made.true_y[after, 0], -1.0, 3.0)
    assert figures.settling_s <= 1.0
    assert abs(-1.0 - made.true_y[-1, 0]) <= 0.03
    assert np.abs(made.command_v).max() <= 9.9


@pytest.mark.parametrize("payload_kg", [0.0, 0.4])
@pytest.mark.parametrize(
    ("setpoint_v", "changed_v", "at_s"), [(3.0, 5.0, 0.1), (5.0, 0.0, 0.4), (-5.0, 5.0, 0.25)]
)
def test_change___at_any_time_of_a_move___stays_within_the_command_of_one_move(
    payload_kg: float, setpoint_v: float, changed_v: float, at_s: float
) -> None:
    reference_v = np.concatenate([constant(setpoint_v, at_s), constant(changed_v, 2.5)])

    made = run(planned(payload_kg=payload_kg), reference_v, RigParameters(payload_kg=payload_kg))

    assert np.abs(made.command_v).max() <= 8.0
    # A move back needs the time of the braking besides.
    after = made.time_s >= at_s + 1.6
    assert np.abs(changed_v - made.true_y[after, 0]).max() <= 0.05 * abs(changed_v - setpoint_v)


def test_changes___of_a_plan_that_is_played_alone___keep_the_peak_in_their_sum() -> None:
    """Without differences the effort is the plan alone."""
    law = planned(kp=0.0, kd=0.0, ksg=0.0)

    setpoints_v = [2.0] * 40 + [5.0] * 30 + [-4.0] * 10 + [1.0] * 300
    effort_v = [law.step(AT_REST, setpoint_v).effort_v for setpoint_v in setpoints_v]

    # 6 V with the move, twice the compensation of 0.7 V more against it.
    assert np.abs(effort_v).max() <= 7.4 * 1.02
    assert np.abs(effort_v[-30:]).max() == 0.0


def test_stream_of_set_points___is_followed_to_its_end() -> None:
    ramp_v = np.concatenate([np.linspace(0.0, 3.0, 300), constant(3.0, 1.5)])

    made = run(planned(), ramp_v)

    late_v = ramp_v - made.true_y[:, 0]
    # A plan takes a quarter of a second and waits for its turn: a third of 3 V/s.
    assert np.abs(late_v).max() <= 1.1
    assert abs(late_v[-1]) <= 0.03


def test_payload___once_detected___is_planned_for() -> None:
    law = planned()
    reference_v = np.concatenate([constant(3.0, 3.0), constant(-2.0, 3.0)])

    made = run(law, reference_v, RigParameters(payload_kg=0.4))

    second = made.time_s >= 3.0
    assert law.payload.detected
    assert law.payload.payload_kg == pytest.approx(0.4, abs=0.06)
    figures = step_figures(made.time_s[second], made.true_y[second, 0], -2.0, 3.0)
    assert figures.overshoot <= 0.06
    assert figures.settling_s <= 1.3
    # A plan for 0 g moves 5 V in 0.5 s, which this arm cannot follow.
    assert np.count_nonzero(np.abs(made.effort[second]) > 1.0) / RATE_HZ >= 0.7


def test_friction___half_as_much_again___needs_the_observer() -> None:
    rig = RigParameters()
    stiff = replace(rig, coulomb_friction_nm=1.5 * rig.coulomb_friction_nm)

    without, with_it = (
        run(planned(observer_hz=hz), constant(3.0, 4.0), stiff).true_y[-1, 0] for hz in (0.0, 5.0)
    )

    assert abs(3.0 - without) >= 0.1
    assert abs(3.0 - with_it) <= 0.03


def test_model___of_a_heavier_arm___is_planned_for() -> None:
    """A model of the flat arm itself gives the plans of its figures."""
    arm = ArmFigures().at(0.3)
    w, drag, gain = 2.0 * pi * arm.frequency_hz, arm.drag_per_s, arm.gain_per_s2
    A = [[0, 1, 0, 0], [0, -drag, 0, 0], [0, 0, 0, 1], [0, 0, -(w**2), -0.074 * w]]
    C = [[1, 0, arm.hub_share, 0], [0, 0, 1, 0], [0, 0, 1, 0], [0, 1, 0, arm.hub_share]]
    B = np.array([[0.0], [gain], [0.0], [gain]])
    continuous = state_space(np.array(A), B, np.array(C), 0.0, 0.0)
    model = continuous.sample(1.0 / RATE_HZ)
    still = {"kp": 0.0, "kd": 0.0, "ksg": 0.0}

    law, expected = build_law("planned", still, model), planned(payload_kg=0.3, **still)

    for _ in range(300):
        effort_v = expected.step(AT_REST, 3.0).effort_v
        assert law.step(AT_REST, 3.0).effort_v == pytest.approx(effort_v, abs=0.15)


def test_model___without_bending___is_refused() -> None:
    model = identified_model()
    model.A[:] = 0.5 * np.eye(len(model.A))

    with pytest.raises(SettingError, match="no bending mode"):
        build_law("planned", model=model)


def test_memory___in_a_move___goes_on_to_the_bit() -> None:
    values = {"observer_hz": 5.0}
    first, second = (Handover(build_law("planned", values)) for _ in range(2))

    def answers(law: Handover, begin: int, end: int) -> list[Effort]:
        volts = [(0.004 * k, 0.2 - 0.001 * k, 0.01, 0.05) for k in range(end)]
        return [law.step(volts[k], 2.0 if k < 40 else 3.5) for k in range(begin, end)]

    answers(first, 0, 77)
    memory = {group: list(numbers) for group, numbers in first.memory().items()}
    # Distance, next sample, two phases of each move, and those that the second takes the place of.
    assert np.count_nonzero(memory["moves"]) == 2 * (2 + 4) + 4

    second.remember(memory)

    assert answers(second, 77, 300) == answers(first, 77, 300)
    fresh = build_law("planned").memory()
    assert {name: len(group) for name, group in fresh.items()} == {
        name: len(group) for name, group in memory.items() if name not in {"handover", "asked"}
    }
