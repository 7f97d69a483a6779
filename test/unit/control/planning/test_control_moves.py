"""Plans beside the flat model's equations, which are integrated here, and beside its figures."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_control.models.arm_model import OUTPUTS
from flexarm_control.planning.fitted_arm import fitted_arm
from flexarm_control.planning.flat_arm import ArmFigures, FlatArm
from flexarm_control.planning.move import MoveSettings, plan, progress, shortest_samples
from flexarm_core.errors import SettingError
from flexarm_ident.models.state_space import state_space
from support.flat_model import held

RATE_HZ = 300.0
ARMS = st.builds(
    FlatArm,
    gain_per_s2=st.floats(2.0, 40.0),
    drag_per_s=st.floats(0.0, 3.0),
    frequency_hz=st.floats(3.0, 15.0),
    damping_ratio=st.floats(0.0, 0.2),
    hub_share=st.floats(0.0, 30.0),
    middle_strain_s2=st.floats(-0.1, 0.1),
)
HEIGHTS_V = st.floats(0.1, 6.0).flatmap(lambda size: st.sampled_from([size, -size]))


def test_progress___at_both_ends___rests_with_four_derivatives() -> None:
    start, end = progress(np.array([0.0, 1.0])).T

    assert start == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-9)
    assert end == pytest.approx([1.0, 0.0, 0.0, 0.0, 0.0], abs=1e-9)


def test_progress___derivatives___are_those_of_the_one_before() -> None:
    share = np.linspace(0.0, 1.0, 2001)
    values = progress(share)

    assert np.all(values[1] >= -1e-9)
    for lower, upper in pairwise(values):
        slopes = np.gradient(lower, share)[2:-2]
        assert slopes == pytest.approx(upper[2:-2], abs=1e-4 * np.abs(upper).max() + 1e-9)


@settings(max_examples=15)
@given(ARMS, HEIGHTS_V, st.floats(0.3, 1.5))
def test_plan___played_on_the_model___gives_its_own_outputs_and_rests(
    arm: FlatArm, height_v: float, duration_s: float
) -> None:
    rate_hz = 2000.0
    samples = round(duration_s * rate_hz)
    move = plan(arm, height_v, samples, rate_hz)
    A, B, C = held(arm, rate_hz)

    state, outputs = np.zeros((4, 1)), []
    for planned in move:
        outputs.append((C @ state).ravel())
        state = A @ state + B * planned.command_v

    expected = [(each.left_v + height_v, each.middle_strain_v, each.speed_v) for each in move]
    scales = np.abs(expected).max(axis=0) + 1e-6
    assert np.abs((np.array(outputs) - expected) / scales).max() <= 5e-3
    assert (C @ state)[0, 0] == pytest.approx(height_v, rel=2e-3)
    # At the end nothing moves: neither the rigid motion nor the mode.
    assert np.abs(state[1:, 0]).max() <= 5e-3 * abs(height_v) * 2.0 * pi * arm.frequency_hz


@settings(max_examples=50)
@given(ARMS, HEIGHTS_V, st.floats(1.0, 9.0))
def test_shortest_move___keeps_the_peak_and_one_sample_less_does_not(
    arm: FlatArm, height_v: float, peak_v: float
) -> None:
    wanted = MoveSettings(peak_v=peak_v, shortest_s=0.05)
    samples = shortest_samples(arm, height_v, wanted, RATE_HZ)

    def peak(count: int) -> float:
        return max(abs(each.command_v) for each in plan(arm, height_v, count, RATE_HZ))

    assert peak(samples) <= 1.001 * peak_v
    # Held commands of a short move miss its true peak by a little.
    if samples > 15:
        assert peak(samples - 1) >= 0.97 * peak_v


def test_shortest_move___of_a_small_step___takes_the_least_duration() -> None:
    samples = shortest_samples(ArmFigures().at(0.0), 0.1, MoveSettings(shortest_s=0.5), RATE_HZ)

    assert samples == 150


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


@pytest.mark.parametrize("payload_kg", [0.0, 0.2, 0.4])
def test_fitted_arm___of_the_flat_model_itself___has_its_figures(payload_kg: float) -> None:
    arm = ArmFigures().at(payload_kg)
    A, B, C = held(arm, RATE_HZ)
    rows = C[[0, 1, 1, 2]]

    found = fitted_arm(
        state_space(A, B, rows, 0.0, 1.0 / RATE_HZ, inputs=("command_v",), outputs=OUTPUTS)
    ).at(0.3)

    for name, value in vars(arm).items():
        assert getattr(found, name) == pytest.approx(value, rel=0.02, abs=0.01), name


def test_fitted_arm___position_of_a_spring___is_refused() -> None:
    A, B, C = held(replace(ArmFigures().at(0.0), hub_share=0.0), RATE_HZ)
    A[0, 0], rows = 0.5, C[[0, 1, 1, 2]]
    model = state_space(A, B, rows, 0.0, 1.0 / RATE_HZ, inputs=("command_v",), outputs=OUTPUTS)

    with pytest.raises(SettingError, match="identify the arm from a closed-loop experiment"):
        fitted_arm(model)
