from __future__ import annotations

from math import inf

from flexarm_bringup.verbs.simulated.design import remarks
from flexarm_control.design.margins import margins
from flexarm_control.laws.gains import PdpGains
from flexarm_control.models.nominal_models import nominal_model

MODEL = nominal_model(0.0)
AMPLE = margins(MODEL, PdpGains(kp=0.5, kd=3.3, ksg=0.07))
SMALL = margins(MODEL, PdpGains(kp=1.5, kd=3.3, ksg=0.07))
UNSTABLE = margins(MODEL, PdpGains(kp=5.0, kd=0.1, ksg=0.01))


def test_model_that_calls_a_law_unstable_which_has_settled___is_doubted() -> None:
    assert not UNSTABLE.stable
    (reported,) = remarks(UNSTABLE, packaged_s=1.0, designed_s=1.0)
    assert "the packaged controller is unstable on this model" in reported
    assert remarks(UNSTABLE, packaged_s=inf, designed_s=1.0) == []


def test_packaged_law_that_settles_much_earlier___is_advised_where_its_margins_suffice() -> None:
    assert AMPLE.gain_margin_db > 10.0
    assert AMPLE.phase_margin_deg > 55.0
    for designed_s in (2.0, inf):
        (reported,) = remarks(AMPLE, packaged_s=1.0, designed_s=designed_s)
        assert "the packaged controller settled much earlier" in reported
    assert remarks(AMPLE, packaged_s=1.0, designed_s=1.2) == []
    assert SMALL.stable
    assert SMALL.gain_margin_db < 10.0
    assert remarks(SMALL, packaged_s=1.0, designed_s=2.0) == []


def test_law_without_a_loop_of_its_own___is_not_compared() -> None:
    assert remarks(None, packaged_s=1.0, designed_s=2.0) == []
