from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control.design.margins import margins
from flexarm_control.design.regulator_tuning import RegulatorLoop, law_loop
from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.ilqr import IlqrWeights, design_ilqr
from flexarm_control.laws.registry import LAWS
from flexarm_control.laws.regulator_loop import closed_loop, controller_model, stabilising_design
from flexarm_control.models.nominal_models import identified_model, nominal_model

if TYPE_CHECKING:
    import control

    from flexarm_control.design.margins import Margins

DELAY_S = 6e-4


def _packaged(law: str, model: control.StateSpace, delay_s: float = DELAY_S) -> Margins:
    loop = law_loop(law, model, delay_s=delay_s)
    assert loop is not None
    return loop.margins()


def test_pdpc___has_the_margins_of_the_gains_that_a_controller_has_by_default() -> None:
    usual = {spec.name: spec.default for spec in LAWS["pdpc"].parameters}
    gains = PdpGains(*(float(str(usual[name])) for name in ("kp", "kd", "ksg")))
    found = _packaged("pdpc", nominal_model(0.2))
    wanted = margins(nominal_model(0.2), gains, delay_s=DELAY_S)
    assert found.gain_margin_db == pytest.approx(wanted.gain_margin_db)
    assert found.phase_margin_deg == pytest.approx(wanted.phase_margin_deg)


def test_ilqr___has_those_of_the_packaged_design_on_another_model() -> None:
    model = nominal_model(0.4)
    found = _packaged("ilqr", model)
    own = RegulatorLoop(model, delay_s=DELAY_S).margins(
        design_ilqr(identified_model(), IlqrWeights())
    )
    assert found.gain_margin_db == pytest.approx(own.gain_margin_db)
    later = _packaged("ilqr", model, delay_s=0.02)
    assert later.phase_margin_deg < found.phase_margin_deg


@pytest.mark.parametrize("law", ["lqg", "pi"])
def test_law_without_one_loop_of_its_own___has_none(law: str) -> None:
    assert law_loop(law, nominal_model(0.2)) is None


def test_designed_regulator___has_the_sensitivity_of_its_closed_loop() -> None:
    model, weights = identified_model(), IlqrWeights(effort=3.0, ki=1e-4)
    loop = law_loop("ilqr", model, asdict(weights))
    assert loop is not None
    design = stabilising_design(design_ilqr, model, weights)
    closed = closed_loop(design, model)
    rows = slice(None, None, 500)
    z = np.exp(2j * np.pi * loop.frequency_hz[rows] * model.dt)
    # From the reference, the effort is S times what the controller makes of it without feedback.
    position = closed(z)[0, 0]
    alone = model(z)[0, 0] * controller_model(design)(z)[0, 4]
    np.testing.assert_allclose(loop.sensitivity[rows] * alone, position, rtol=1e-6)
    np.testing.assert_allclose((1.0 + loop.response) * loop.sensitivity, 1.0, rtol=1e-9)
