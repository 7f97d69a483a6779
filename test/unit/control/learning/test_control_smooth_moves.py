"""Smooth moves of the flat model beside its equations of motion."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_control.learning.trajectory import progress, unit_move
from flexarm_control.planning.flat_arm import ArmFigures
from support.flat_model import held


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
@given(st.floats(0.0, 0.5), st.floats(0.3, 1.5))
def test_move___played_on_the_model___gives_its_own_outputs_and_rests(
    payload_kg: float, duration_s: float
) -> None:
    rate_hz = 2000.0
    arm = ArmFigures().at(payload_kg)
    *outputs_v, command_v = unit_move(arm, round(duration_s * rate_hz), rate_hz)
    A, B, C = held(arm, rate_hz)

    state, outputs = np.zeros((4, 1)), []
    for each_v in command_v:
        outputs.append((C @ state).ravel())
        state = A @ state + B * each_v

    scales = np.abs(outputs_v).max(axis=1)
    np.testing.assert_allclose(
        np.array(outputs) / scales, np.array(outputs_v).T / scales, atol=1e-3
    )
    assert C @ state == pytest.approx(np.array([[1.0], [0.0], [0.0]]), abs=1e-3)
