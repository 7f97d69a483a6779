"""Fastest rigid moves beside closed forms and the equation of motion, which is integrated."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from flexarm_control.planning.flat_arm import ArmFigures, FlatArm
from flexarm_control.planning.move import (
    LONGEST_S,
    Limits,
    Phase,
    Phases,
    duration_s,
    fastest,
    what_is_left,
)

ARM = ArmFigures().at(0.2)
LIMITS = Limits(6.0, 1.25)
HEIGHTS_V = st.floats(0.05, 10.0).flatmap(lambda size: st.sampled_from([size, -size]))


def end_of(arm: FlatArm, phases: Phases) -> tuple[float, float]:
    """Integrate r'' + d r' = g u; return position and speed at the end."""
    state = np.zeros(2)
    for lasts_s, command_v in phases:

        def rates(_: float, now: np.ndarray, command_v: float = command_v) -> list[float]:
            return [now[1], arm.gain_per_s2 * command_v - arm.drag_per_s * now[1]]

        state = solve_ivp(rates, (0.0, lasts_s), state, rtol=1e-10, atol=1e-12).y[:, -1]
    return float(state[0]), float(state[1])


@pytest.mark.parametrize("braking", [1.0, 1.6])
def test_move___without_drag___has_the_durations_of_constant_accelerations(braking: float) -> None:
    arm = replace(ARM, drag_per_s=1e-3)
    forward, back = fastest(arm, (), 4.0, Limits(5.0, braking))

    faster = arm.gain_per_s2 * 5.0
    slower = braking * faster
    top = sqrt(2.0 * 4.0 / (1.0 / faster + 1.0 / slower))
    assert forward == pytest.approx((top / faster, 5.0), rel=2e-3)
    assert back == pytest.approx((top / slower, -5.0 * braking), rel=2e-3)


@settings(max_examples=25)
@given(HEIGHTS_V, HEIGHTS_V, st.floats(0.0, 1.5))
def test_move___that_takes_over_a_speed___ends_at_rest_where_it_should(
    height_v: float, change_v: float, part: float
) -> None:
    first = fastest(ARM, (), height_v, LIMITS)
    elapsed_s = part * duration_s(first)
    left = what_is_left(first, elapsed_s)

    changed = fastest(ARM, left, change_v, LIMITS)

    done = tuple(Phase(min(p.lasts_s, t), p.command_v) for p, t in begun(first, elapsed_s))
    position_v, speed_v_per_s = end_of(ARM, (*done, *changed))
    assert position_v == pytest.approx(height_v + change_v, abs=1e-6)
    assert speed_v_per_s == pytest.approx(0.0, abs=1e-5)
    assert max(abs(phase.command_v) for phase in changed) <= 1.2500001 * 6.0


def begun(phases: Phases, elapsed_s: float) -> list[tuple[Phase, float]]:
    """Return the phases that have begun, each with the time since."""
    found = []
    for phase in phases:
        if elapsed_s > 0.0:
            found.append((phase, elapsed_s))
        elapsed_s -= phase.lasts_s
    return found


def test_what_is_left___of_two_phases___is_their_rest() -> None:
    phases = (Phase(0.5, 2.0), Phase(0.25, -3.0))

    assert what_is_left(phases, 0.0) == phases
    assert what_is_left(phases, 0.25) == (Phase(0.25, 2.0), Phase(0.25, -3.0))
    assert what_is_left(phases, 0.625) == (Phase(0.125, -3.0),)
    assert what_is_left(phases, 0.75) == ()


def test_move___that_would_take_too_long___has_a_larger_command() -> None:
    lazy = replace(ARM, gain_per_s2=0.02)

    phases = fastest(lazy, (), 5.0, Limits(0.5, 1.0))

    assert duration_s(phases) <= LONGEST_S
    assert end_of(lazy, phases)[0] == pytest.approx(5.0, abs=1e-6)
