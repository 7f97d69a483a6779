"""What a tuning says of its starts."""

from __future__ import annotations

import re

import pytest

from flexarm_control.design.tuning import PdpTuning, PiTuning, Search, tune_pi
from flexarm_control.design.tuning_job import confirmation, pi_stopped_by, stopped_by
from flexarm_control.laws.gains import PdpGains, PiGains
from flexarm_control.models.nominal_models import nominal_model

Ends = list[tuple[float, float, bool]]


def tuned(ends: Ends) -> PdpTuning:
    """Tuning whose starts ended at these Kd, J and feasibility."""
    searches = tuple(
        Search(PdpGains(), PdpGains(kd=kd), criterion, feasible) for kd, criterion, feasible in ends
    )
    feasible = [each for each in searches if each.feasible]
    best = min(feasible, key=lambda each: each.criterion)
    spread = max(abs(each.gains.kd - best.gains.kd) for each in feasible)
    return PdpTuning(best.gains, best.criterion, (), (), (), (), searches, spread)


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ([(4.0, 1.0, True), (4.01, 1.0, True)], "2 of 2 starts met the constraints and agree"),
        (
            [(4.0, 1.0, True), (4.01, 1.0, True), (4.5, 1.1, True)],
            "do NOT agree.*; 2 end at these, the others at a J up to 10 % larger.*compare",
        ),
        ([(4.0, 1.0, True), (4.5, 1.002, True)], "do NOT agree.*the same J within 1 %.*compare"),
        ([(4.0, 1.0, True), (4.5, 1.1, True)], "do NOT agree.*no other start confirms it. Compare"),
        ([(4.0, 1.0, True), (4.5, 0.9, False)], "1 of 2 .*no other start confirms.*with care"),
    ],
)
def test_starts___that_agree_or_not___are_reported_with_what_to_do(ends: Ends, words: str) -> None:
    assert re.search(words, confirmation(tuned(ends)))


def test_bound___that_stops_the_search___is_reported_with_what_to_do() -> None:
    assert stopped_by(()) == "active: none"
    assert stopped_by(("gain margin of model 1",)) == "active: gain margin of model 1"
    said = stopped_by(("gain margin of model 1", "bound of kp"))
    assert said.startswith(
        "active: gain margin of model 1, bound of kp; the best gain may lie beyond"
    )
    assert "signals are in V" in said


@pytest.mark.parametrize(
    ("gains", "active", "words"),
    [
        (PiGains(0.4, 0.01), (), "active: none"),
        (PiGains(0.3, 5e-6), ("bound of ki",), "active: bound of ki; the step needs no integral"),
        (PiGains(2.0, 0.01), ("bound of kp",), "active: bound of kp; the best gain may lie beyond"),
        (PiGains(0.3, 0.2), ("bound of ki",), "active: bound of ki; the best gain may lie beyond"),
    ],
)
def test_pi___at_a_bound___is_reported_with_what_it_means(
    gains: PiGains, active: tuple[str, ...], words: str
) -> None:
    assert pi_stopped_by(PiTuning(gains, 1.0, active, ())).startswith(words)


def test_pi___arm_that_swings_long___ends_at_the_least_integral() -> None:
    # The heaviest payload of the thesis: any integral prolongs the vibration.
    assert tune_pi(nominal_model(0.4)).active == ("bound of ki",)
    assert tune_pi(nominal_model(0.0)).active == ()
