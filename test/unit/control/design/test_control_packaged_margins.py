from __future__ import annotations

import pytest

from flexarm_control.design.margins import margins
from flexarm_control.design.regulator_margins import RegulatorLoop, packaged_margins
from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.ilqr import IlqrWeights, design_ilqr
from flexarm_control.laws.registry import LAWS
from flexarm_control.models.nominal_models import identified_model, nominal_model

DELAY_S = 6e-4


def test_pdpc___has_the_margins_of_the_gains_that_a_controller_has_by_default() -> None:
    usual = {spec.name: spec.default for spec in LAWS["pdpc"].parameters}
    gains = PdpGains(*(float(str(usual[name])) for name in ("kp", "kd", "ksg")))
    found = packaged_margins("pdpc", nominal_model(0.2), delay_s=DELAY_S)
    assert found is not None
    wanted = margins(nominal_model(0.2), gains, delay_s=DELAY_S)
    assert found.gain_margin_db == pytest.approx(wanted.gain_margin_db)
    assert found.phase_margin_deg == pytest.approx(wanted.phase_margin_deg)


def test_ilqr___has_those_of_the_packaged_design_on_another_model() -> None:
    model = nominal_model(0.4)
    found = packaged_margins("ilqr", model, delay_s=DELAY_S)
    assert found is not None
    own = RegulatorLoop(model, delay_s=DELAY_S).margins(
        design_ilqr(identified_model(), IlqrWeights())
    )
    assert found.gain_margin_db == pytest.approx(own.gain_margin_db)
    later = packaged_margins("ilqr", model, delay_s=0.02)
    assert later is not None
    assert later.phase_margin_deg < found.phase_margin_deg


@pytest.mark.parametrize("law", ["lqg", "pi"])
def test_law_without_one_loop_of_its_own___has_none(law: str) -> None:
    assert packaged_margins(law, nominal_model(0.2)) is None
