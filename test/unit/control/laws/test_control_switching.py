"""A law replaced in the middle of a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from flexarm_control import Effort, Pdp, PdpGains, build_law
from flexarm_control.laws.law_protocol import Memoryless
from flexarm_control.laws.switching import FADE_V, Handover

if TYPE_CHECKING:
    from collections.abc import Sequence

VOLTS = (1.0, 0.0, 0.0, 0.0)


class _Constant(Memoryless):
    def __init__(self, effort_v: float, compensation_v: float = 0.0) -> None:
        self.answer = Effort(effort_v, compensation_v)
        self.resets = 0

    def step(self, _volts: Sequence[float], _reference_v: float) -> Effort:
        return self.answer

    def reset(self) -> None:
        self.resets += 1


def test_handover___one_law___is_that_law() -> None:
    law = Pdp()
    handover = Handover(law)

    for reference_v in (0.0, 3.0, -3.0):
        handover.replace(law)
        assert handover.step(VOLTS, reference_v) == law.step(VOLTS, reference_v)


def test_handover___new_law___starts_at_the_old_command_and_fades_to_its_own() -> None:
    handover = Handover(_Constant(2.0, 0.5))
    handover.step(VOLTS, 0.0)

    handover.replace(_Constant(1.0, -0.5))
    commands_v = [sum(handover.step(VOLTS, 0.0)) for _ in range(30)]

    expected_v = [max(0.5, 2.5 - k * FADE_V) for k in range(30)]
    assert commands_v == pytest.approx(expected_v)
    assert handover.step(VOLTS, 0.0) == Effort(1.0, -0.5)


def test_handover___replaced_twice_before_a_sample___takes_the_last() -> None:
    handover = Handover(_Constant(2.0))
    handover.step(VOLTS, 0.0)

    handover.replace(_Constant(-9.0))
    handover.replace(_Constant(1.0))

    assert handover.step(VOLTS, 0.0) == pytest.approx((2.0, 0.0))
    assert handover.step(VOLTS, 0.0) == pytest.approx((2.0 - FADE_V, 0.0))


def test_handover___fault___is_zero_at_once() -> None:
    handover = Handover(Pdp(PdpGains(1.0, 0.0, 0.0)))
    handover.step(VOLTS, 3.0)

    handover.replace(Pdp(PdpGains(2.0, 0.0, 0.0)))

    assert handover.step((math.nan, 0.0, 0.0, 0.0), 3.0) == Effort(0.0, 0.0)


def test_handover___reset___forgets_the_difference_and_resets_the_law() -> None:
    law = _Constant(1.0)
    handover = Handover(_Constant(2.0))
    handover.step(VOLTS, 0.0)
    handover.replace(law)
    handover.step(VOLTS, 0.0)

    handover.reset()

    assert law.resets == 1
    assert handover.step(VOLTS, 0.0) == Effort(1.0, 0.0)


def test_handover___to_ilqr_at_rest___does_not_swing_the_command() -> None:
    handover = Handover(Pdp())
    handover.step((3.0, 0.0, 0.0, 0.0), 3.0)

    handover.replace(build_law("ilqr"))

    for _ in range(300):
        assert abs(sum(handover.step((3.0, 0.0, 0.0, 0.0), 3.0))) < 0.1
