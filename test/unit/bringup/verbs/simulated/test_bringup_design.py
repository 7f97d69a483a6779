from __future__ import annotations

from flexarm_bringup.verbs.simulated.design import doubts
from flexarm_control.design.margins import margins
from flexarm_control.laws.gains import PdpGains
from flexarm_control.models.nominal_models import nominal_model

STABLE = margins(nominal_model(0.0), PdpGains(kp=0.5, kd=3.3, ksg=0.07))
UNSTABLE = margins(nominal_model(0.0), PdpGains(kp=5.0, kd=0.1, ksg=0.01))


def test_doubts___of_a_model_that_calls_a_law_unstable_which_has_settled() -> None:
    assert STABLE.stable
    assert not UNSTABLE.stable
    (told,) = doubts(UNSTABLE, has_settled=True)
    assert "the model calls the loop of the packaged law unstable" in told


def test_doubts___of_a_model_that_nothing_speaks_against___are_none() -> None:
    assert doubts(UNSTABLE, has_settled=False) == []
    assert doubts(STABLE, has_settled=True) == []
    assert doubts(None, has_settled=True) == []
