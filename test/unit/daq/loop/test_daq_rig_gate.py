from __future__ import annotations

import math

import pytest

from flexarm_core.rig_description import described
from flexarm_daq.loop.limiter import Gate, rig_gate

TEXT = """
name: three
rate_hz: 100
inputs:
  lamp: {unit: W, limits: [0, 40], slew_per_s: 500}
  elbow: {quantity: torque, unit: N m, limits: [1, 9], rest: 5, slew_per_s: 100}
  hip: {quantity: torque, unit: N m, limits: 2}
outputs:
  warmth: {unit: K}
  hip_rad: {quantity: angle, unit: rad}
  elbow_deg: {quantity: angle, unit: deg}
joints:
  hip: {input: hip, angle: hip_rad, travel: [-1, 2]}
  elbow: {input: elbow, angle: elbow_deg, travel: [10, 90], sign: -1}
driver: rig.py:Mine
"""
REST = (0.0, 5.0, 0.0)
INSIDE = (300.0, 0.0, 50.0)
PERIOD_S = 0.01


def apply(
    gate: Gate, commands: tuple[float, float, float], outputs: tuple[float, float, float] = INSIDE
) -> tuple[tuple[float, ...], tuple[str, ...]]:
    limited = gate.apply(commands, (0.0, 0.0, 0.0), outputs, PERIOD_S)
    return limited.commands, limited.reasons


def test_gate___of_a_rig___rests_and_starts_where_each_input_does() -> None:
    gate = rig_gate(described(TEXT))
    assert gate.rest == REST
    # One period: 5 W, 1 N m from rest at 5 N m, and as much as the hip wants.
    assert apply(gate, (40.0, 9.0, 2.0)) == ((5.0, 6.0, 2.0), ("slew",))
    gate.reset()
    assert apply(gate, (3.0, 4.5, -1.0)) == ((3.0, 4.5, -1.0), ())
    gate.reset()
    assert apply(gate, (3.0, 0.0, -1.0)) == ((3.0, 4.0, -1.0), ("magnitude", "slew"))


def test_gate___each_input___has_limits_of_its_own() -> None:
    gate = rig_gate(described(TEXT.replace(", slew_per_s: 500", "").replace("s: 100", "s: 1e6")))
    assert apply(gate, (99.0, 99.0, 99.0)) == ((40.0, 9.0, 2.0), ("magnitude",))
    assert apply(gate, (-9.0, -9.0, -9.0)) == ((0.0, 1.0, -2.0), ("magnitude",))


@pytest.mark.parametrize(
    ("outputs", "refused", "passed"),
    [
        # The elbow turns against its command, about its rest of 5 N m.
        ((300.0, 0.0, 91.0), (3.0, 4.5, 1.0), (3.0, 5.5, 1.0)),
        ((300.0, 0.0, 9.0), (3.0, 5.5, 1.0), (3.0, 4.5, 1.0)),
        ((300.0, 2.1, 50.0), (3.0, 4.5, 0.1), (3.0, 4.5, -0.1)),
        ((300.0, -1.1, 50.0), (3.0, 4.5, -0.1), (3.0, 4.5, 0.1)),
    ],
    ids=["elbow high", "elbow low", "hip high", "hip low"],
)
def test_gate___beyond_the_travel_of_one_joint___lets_its_input_lead_back_only(
    outputs: tuple[float, float, float],
    refused: tuple[float, float, float],
    passed: tuple[float, float, float],
) -> None:
    gate = rig_gate(described(TEXT))
    assert apply(gate, passed, outputs) == (passed, ())
    gate.reset()
    at = 1 if refused[1] != passed[1] else 2
    given = tuple(REST[at] if place == at else each for place, each in enumerate(refused))
    assert apply(gate, refused, outputs) == (given, ("position_bound",))


def test_gate___that_holds___rests_beyond_the_travel_whatever_is_asked() -> None:
    gate = rig_gate(described(TEXT + "safety: {end_of_travel: hold}\n"))
    assert apply(gate, (3.0, 5.5, 1.0), (300.0, 0.0, 91.0)) == (
        (3.0, 5.0, 1.0),
        ("position_bound",),
    )


def test_gate___with_one_command_that_is_not_a_number___rests_that_input_alone() -> None:
    gate = rig_gate(described(TEXT))
    assert apply(gate, (3.0, math.nan, 1.0)) == ((3.0, 5.0, 1.0), ("not_finite",))
    assert apply(gate, (3.0, 5.5, 1.0), (math.nan, math.nan, 50.0)) == (
        (3.0, 5.5, 0.0),
        ("not_finite",),
    )


def test_gate___after_a_fault___slews_from_rest() -> None:
    gate = rig_gate(described(TEXT))
    for _ in range(3):
        apply(gate, (0.0, 9.0, 0.0))
    assert apply(gate, (0.0, 9.0, 0.0), (300.0, 0.0, 9.0))[0] == REST
    assert apply(gate, (0.0, 9.0, 0.0))[0] == (0.0, 6.0, 0.0)
