"""Plans beside the flat model's equations, which are integrated here, and beside its figures."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_control.models.arm_model import OUTPUTS
from flexarm_control.planning.flat_arm import ArmFigures, FlatArm, fitted_arm
from flexarm_control.planning.move import Limits, duration_s, fastest, plan, what_is_left
from flexarm_core.errors import SettingError
from flexarm_ident.models.state_space import state_space
from support.flat_model import held

RATE_HZ = 300.0
ARMS = st.builds(
    FlatArm,
    gain_per_s2=st.floats(2.0, 40.0),
    drag_per_s=st.floats(0.001, 3.0),
    frequency_hz=st.floats(3.0, 15.0),
    damping_ratio=st.floats(0.0, 0.2),
    hub_share=st.floats(0.0, 30.0),
    middle_strain_s2=st.floats(-0.1, 0.1),
)
LIMITS = Limits(6.0, 1.2)
HEIGHTS_V = st.floats(0.1, 6.0).flatmap(lambda size: st.sampled_from([size, -size]))


def played(arm: FlatArm, command_v: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Play a command on the equations; return the outputs before each sample and the end."""
    A, B, C = held(arm, rate_hz)
    state, outputs = np.zeros((4, 1)), []
    for each_v in command_v:
        outputs.append((C @ state).ravel())
        state = A @ state + B * each_v
    return np.array(outputs), state.ravel()


@settings(max_examples=25)
@given(ARMS, HEIGHTS_V)
def test_plan___played_on_the_model___gives_its_own_outputs_and_rests(
    arm: FlatArm, height_v: float
) -> None:
    move = plan(arm, height_v, fastest(arm, (), height_v, LIMITS), (), RATE_HZ)

    outputs, end = played(arm, np.array([each.command_v for each in move]), RATE_HZ)

    expected = [(each.left_v + height_v, each.middle_strain_v, each.speed_v) for each in move]
    scales = np.abs(expected).max(axis=0) + 1e-6
    assert np.abs((outputs - expected) / scales).max() <= 1e-6
    # At the end nothing moves: neither the rigid motion nor the mode.
    assert end == pytest.approx([height_v, 0.0, 0.0, 0.0], abs=1e-6 * abs(height_v))


@settings(max_examples=25)
@given(ARMS, HEIGHTS_V)
def test_plan___of_any_move___keeps_both_limits(arm: FlatArm, height_v: float) -> None:
    move = plan(arm, height_v, fastest(arm, (), height_v, LIMITS), (), RATE_HZ)

    command_v = np.sign(height_v) * np.array([each.command_v for each in move])
    assert command_v.max() <= 1.02 * LIMITS.peak_v
    assert -command_v.min() <= 1.02 * LIMITS.braking * LIMITS.peak_v


@pytest.mark.parametrize("error", [-0.15, 0.15])
def test_plan___mode_slower_or_faster_than_planned___swings_a_third_as_far_as_without_windows(
    error: float,
) -> None:
    arm = ArmFigures().at(0.4)
    phases = fastest(arm, (), 3.0, LIMITS)
    command_v = np.array([each.command_v for each in plan(arm, 3.0, phases, (), RATE_HZ)])
    at_s = (np.arange(len(command_v)) + 0.5) / RATE_HZ
    (moved_s, moving_v), (_, braking_v) = phases
    switched_v = np.where(at_s < moved_s, moving_v, braking_v) * (at_s < duration_s(phases))
    other = replace(arm, frequency_hz=(1.0 + error) * arm.frequency_hz, damping_ratio=0.0)

    def swing(played_v: np.ndarray) -> float:
        """Return the amplitude of the mode after the command."""
        _, (_, _, mode, rate) = played(other, played_v, RATE_HZ)
        return float(np.hypot(mode, rate / (2.0 * pi * other.frequency_hz)))

    assert swing(command_v) <= 0.3 * swing(switched_v)


@settings(max_examples=25)
@given(ARMS, HEIGHTS_V, HEIGHTS_V, st.floats(0.0, 1.2))
def test_plans___of_a_change_on_the_way___end_there_and_keep_the_limits(
    arm: FlatArm, height_v: float, change_v: float, part: float
) -> None:
    first = fastest(arm, (), height_v, LIMITS)
    one = plan(arm, height_v, first, (), RATE_HZ)
    begun = round(part * len(one))
    left = what_is_left(first, begun / RATE_HZ)
    second = plan(arm, change_v, fastest(arm, left, change_v, LIMITS), left, RATE_HZ)

    command_v = np.zeros(max(len(one), begun + len(second)))
    command_v[: len(one)] += [each.command_v for each in one]
    command_v[begun : begun + len(second)] += [each.command_v for each in second]

    _, end = played(arm, command_v, RATE_HZ)
    total_v = height_v + change_v
    assert end == pytest.approx([total_v, 0.0, 0.0, 0.0], abs=1e-5)
    assert np.abs(command_v).max() <= 1.05 * LIMITS.braking * LIMITS.peak_v


def test_figures___between_payloads___have_the_inertia_between() -> None:
    figures = ArmFigures()
    light, medium, between = figures.at(0.0), figures.at(0.2), figures.at(0.1)

    mean = 0.5 * (1.0 / light.gain_per_s2 + 1.0 / medium.gain_per_s2)
    assert 1.0 / between.gain_per_s2 == pytest.approx(mean)
    assert between.frequency_hz == pytest.approx(0.5 * (light.frequency_hz + medium.frequency_hz))
    assert figures.at(0.7) == figures.at(0.4)


def test_figures___payloads_that_do_not_increase___are_refused() -> None:
    with pytest.raises(SettingError, match=r"\(0.0, 0.2, 0.1\) must increase"):
        ArmFigures(heavy_kg=0.1)


def test_drag___of_a_gain___is_that_of_the_payload_that_has_it() -> None:
    figures = ArmFigures()

    for payload_kg in (0.0, 0.13, 0.4):
        arm = figures.at(payload_kg)
        assert figures.drag_of(arm.gain_per_s2) == pytest.approx(arm.drag_per_s)
    assert figures.drag_of(100.0) == figures.at(0.0).drag_per_s


@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4])
def test_fitted_arm___of_the_flat_model_itself___has_its_figures(payload_kg: float) -> None:
    arm = ArmFigures().at(payload_kg)
    A, B, C = held(arm, RATE_HZ)
    rows = C[[0, 1, 1, 2]]

    found = fitted_arm(
        state_space(A, B, rows, 0.0, 1.0 / RATE_HZ, inputs=("command_v",), outputs=OUTPUTS),
        ArmFigures(),
    ).at(0.3)

    for name, value in vars(arm).items():
        assert getattr(found, name) == pytest.approx(value, rel=0.02, abs=0.01), name


def test_fitted_arm___position_of_a_spring___is_refused() -> None:
    A, B, C = held(replace(ArmFigures().at(0.0), hub_share=0.0), RATE_HZ)
    A[0, 0], rows = 0.5, C[[0, 1, 1, 2]]
    model = state_space(A, B, rows, 0.0, 1.0 / RATE_HZ, inputs=("command_v",), outputs=OUTPUTS)

    with pytest.raises(SettingError, match="identify the arm from a closed-loop experiment"):
        fitted_arm(model, ArmFigures())
