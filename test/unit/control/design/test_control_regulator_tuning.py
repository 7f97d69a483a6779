"""The effort weight of a regulator: margins kept, criterion recomputed with the stepped law."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control.design.margins import Requirements
from flexarm_control.design.regulator_tuning import EFFORTS, RegulatorLoop, tune_regulator
from flexarm_control.laws.ilqr import Ilqr, IlqrDesign, IlqrWeights, design_ilqr
from flexarm_control.laws.lqg import LqgWeights, design_lqg
from flexarm_control.models.arm_model import delayed
from flexarm_control.models.nominal_models import identified_model, nominal_model
from flexarm_control.models.rigid_and_bending import design_model
from flexarm_control.simulation import simulate_loop
from flexarm_core.errors import SettingError
from support.exhaustive import first_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_control.laws.ilqr import RegulatorWeights

DELAY_S = 0.001
DESIGNS = [(design_ilqr, IlqrWeights(ki=1e-4)), (design_lqg, LqgWeights(loop_delay_s=DELAY_S))]


def stepped_criterion(design: IlqrDesign) -> float:
    """J of (4-3) with equal weights, written out over the samples of the stepped law."""
    late = delayed(identified_model(), DELAY_S)
    dt_s = float(late.dt)
    samples = round(5.0 / dt_s)
    y = simulate_loop(late, Ilqr(design), np.full(samples, 1.0)).y
    time_s = dt_s * np.arange(samples)
    shares = np.abs(y[:, 1:3]) / np.abs(y[:, 1:3]).max(axis=0)
    return float(0.5 * dt_s * (time_s @ np.abs(1.0 - y[:, 0]) + np.sum(time_s @ shares)))


@pytest.mark.parametrize(("design", "weights"), first_of(DESIGNS))
@pytest.mark.slow
def test_tuning___keeps_the_margins_and_no_other_effort_that_does_is_better(
    design: Callable[..., IlqrDesign], weights: RegulatorWeights
) -> None:
    wanted = Requirements(gain_margin_db=9.0, phase_margin_deg=50.0)

    found = tune_regulator([identified_model()], design, weights, wanted, delay_s=DELAY_S)

    assert replace(found.weights, effort=weights.effort) == weights
    (reported,) = found.margins
    assert (reported.gain_margin_db, reported.phase_margin_deg) >= (9.0, 50.0)
    reduced = design_model(identified_model()).model
    loop = RegulatorLoop(identified_model(), delay_s=DELAY_S)
    compared = 0
    for effort in EFFORTS[::3]:
        made = design(reduced, replace(weights, effort=effort))
        margins = loop.margins(made)
        if margins.gain_margin_db >= 9.0 and margins.phase_margin_deg >= 50.0:
            compared += 1
            assert stepped_criterion(made) >= found.criterion - 1e-6
    assert compared >= 2
    assert stepped_criterion(design(reduced, found.weights)) == pytest.approx(found.criterion)


@pytest.mark.slow
def test_tuning___of_margins_out_of_reach___is_refused_with_the_nearest() -> None:
    wanted = Requirements(gain_margin_db=50.0, phase_margin_deg=100.0)

    with pytest.raises(SettingError, match=r"no effort weight .* 50 dB and 100 deg .* nearest, "):
        tune_regulator([identified_model()], design_ilqr, IlqrWeights(), wanted)


def test_tuning___without_models_or_on_one_of_no_arm___is_refused() -> None:
    with pytest.raises(SettingError, match="at least one model"):
        tune_regulator([], design_ilqr, IlqrWeights(), Requirements())
    with pytest.raises(SettingError, match="inputs: 1, outputs: 2"):
        tune_regulator([nominal_model(0.0)[:2, :]], design_ilqr, IlqrWeights(), Requirements())
