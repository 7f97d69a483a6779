"""A law replaced in the middle of a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from flexarm_control import Effort, Pdp, PdpGains, build_law
from flexarm_control.laws.law_protocol import NO_EFFORT, DriveCommand, Memoryless
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


class _Listener(_Constant):
    """Law that notes what it hears before each answer."""

    def __init__(self, effort_v: float, compensation_v: float = 0.0) -> None:
        super().__init__(effort_v, compensation_v)
        self.heard: list[tuple[float, float]] = []

    def hear(self, missing_v: float, cut_v: float) -> None:
        self.heard.append((missing_v, cut_v))


@pytest.mark.parametrize(
    ("drive", "heard"),
    [
        (DriveCommand(5.5, 0.5), (0.0, 0.0)),  # it was sent
        (DriveCommand(2.0, 0.5), (-3.5, 3.5)),  # a limit has cut it
        (DriveCommand(0.0, 0.0), (-5.0, 5.0)),  # nobody drives, or the position bound
        (DriveCommand(7.0, 0.0), (2.0, -2.0)),  # somebody else's
        (DriveCommand(4.5, 0.5), (-1.0, 0.0)),  # the one before: it is late or was lost
    ],
)
def test_law___hears_what_became_of_its_last_answer(
    drive: DriveCommand, heard: tuple[float, float]
) -> None:
    law = _Listener(4.0, 0.5)
    handover = Handover(law)
    handover.step(VOLTS, 0.0, DriveCommand(0.0, 0.0))
    law.answer = Effort(5.0, 0.5)
    handover.step(VOLTS, 0.0, DriveCommand(4.5, 0.5))

    handover.step(VOLTS, 0.0, drive)

    # Before its first answer, nothing is missing.
    assert law.heard == [(0.0, 0.0), (0.0, 0.0), pytest.approx(heard)]


@pytest.mark.parametrize("drive", [None, DriveCommand(math.nan, 0.0), DriveCommand(math.inf, 0.0)])
def test_law___without_a_command_in_force___hears_that_its_answers_were_sent(
    drive: DriveCommand | None,
) -> None:
    law = _Listener(4.0)
    handover = Handover(law)

    answers = [handover.step(VOLTS, 0.0, drive) for _ in range(3)]

    assert answers == [Effort(4.0, 0.0)] * 3
    assert law.heard == [(0.0, 0.0)] * 3


def test_answer_that_was_sent___misses_nothing_to_the_bit() -> None:
    # 0.1 + 0.7 - 0.7 is not 0.1 in floating-point numbers.
    law = _Listener(0.1, 0.7)
    handover = Handover(law)
    handover.step(VOLTS, 0.0, DriveCommand(0.0, 0.0))

    handover.step(VOLTS, 0.0, DriveCommand(0.1 + 0.7, 0.7))

    assert law.heard[-1] == (0.0, 0.0)


def test_handover___new_law_with_a_larger_command___fades_up_to_it() -> None:
    handover = Handover(_Constant(-1.0))
    handover.step(VOLTS, 0.0)

    handover.replace(_Constant(1.0))
    commands_v = [sum(handover.step(VOLTS, 0.0)) for _ in range(30)]

    assert commands_v == pytest.approx([min(1.0, -1.0 + k * FADE_V) for k in range(30)])


def test_new_law___hears_its_own_answers_alone___and_fades_from_the_command_in_force() -> None:
    handover, law = Handover(_Constant(5.0)), _Listener(1.0)
    handover.step(VOLTS, 0.0, DriveCommand(0.0, 0.0))
    handover.replace(law)

    first = handover.step(VOLTS, 0.0, DriveCommand(2.0, 0.0))
    second = handover.step(VOLTS, 0.0, DriveCommand(2.0, 0.0))

    assert (sum(first), sum(second)) == pytest.approx((2.0, 2.0 - FADE_V))
    # The fade is not a limit: it is sent beside the answer, and cuts nothing off.
    assert law.heard == [(0.0, 0.0), pytest.approx((1.0, 0.0))]


def test_law___after_an_answer_to_a_fault___hears_nothing_of_the_answers_before() -> None:
    law = _Listener(4.0)
    handover = Handover(law)
    handover.step(VOLTS, 0.0, DriveCommand(0.0, 0.0))
    law.answer = NO_EFFORT
    handover.step(VOLTS, 0.0, DriveCommand(4.0, 0.0))
    law.answer = Effort(4.0, 0.0)

    handover.step(VOLTS, 0.0, DriveCommand(1.0, 0.0))

    assert law.heard[-1] == (0.0, 0.0)
