"""Linear loop of a regulator, by stepping the law, and designs on identified models."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from flexarm_control.design.regulator_tuning import RegulatorLoop
from flexarm_control.laws.gains import OptionalCompensation
from flexarm_control.laws.ilqr import Ilqr, IlqrDesign, IlqrWeights, design_ilqr
from flexarm_control.laws.lqg import LqgWeights, design_lqg
from flexarm_control.laws.regulator_loop import closed_loop, pole_radius, stabilising_design
from flexarm_control.models.nominal_models import identified_model
from flexarm_control.simulation import simulate_loop
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_control.laws.ilqr import RegulatorWeights

DESIGNS = [(design_ilqr, IlqrWeights()), (design_lqg, LqgWeights())]


def with_pole(pole: float, gain: float) -> control.StateSpace:
    """Packaged model with one more real pole, which hardly shows."""
    model = identified_model()
    return control.StateSpace(
        block_diag(model.A, [[pole]]),
        np.vstack([model.B, [[1.0]]]),
        np.hstack([model.C, np.full((4, 1), gain)]),
        0.0,
        model.dt,
        outputs=model.output_labels,
    )


@pytest.mark.parametrize(("design", "weights"), DESIGNS)
def test_closed_loop___answers_as_the_law_does_sample_by_sample(
    design: Callable[..., IlqrDesign], weights: RegulatorWeights
) -> None:
    found, model = design(identified_model(), weights), with_pole(0.9, 1e-3)
    reference_v = np.full(900, 0.5)
    stepped = simulate_loop(model, Ilqr(found), reference_v)

    loop = closed_loop(found, model)

    answer = control.forced_response(loop, inputs=reference_v, timepts=stepped.time_s)
    np.testing.assert_allclose(answer.outputs.T, stepped.y, atol=1e-9)


@pytest.mark.parametrize(("design", "weights"), DESIGNS)
def test_gain_margin___is_the_factor_at_which_the_loop_becomes_unstable(
    design: Callable[..., IlqrDesign], weights: RegulatorWeights
) -> None:
    found, model = design(identified_model(), weights), identified_model()
    margins = RegulatorLoop(model, delay_s=0.002).margins(found)
    assert margins.stable
    factor = 10.0 ** (margins.gain_margin_db / 20.0)
    assert factor > 1.0

    late = RegulatorLoop(model, delay_s=0.002).model
    radii = []
    for share in (0.98, 1.02):
        louder = control.StateSpace(
            late.A, late.B, share * factor * late.C, 0.0, late.dt, outputs=late.output_labels
        )
        # A louder plant is a larger effort, except for the observer, which knows the effort sent.
        radii.append(pole_radius(closed_loop(found, louder)))
    assert radii[0] < 1.0 < radii[1]


@pytest.mark.parametrize(("design", "weights"), DESIGNS)
def test_stabilising_design___on_a_model_with_more_states___stabilises_it(
    design: Callable[..., IlqrDesign], weights: RegulatorWeights
) -> None:
    model = with_pole(0.95, 1e-3)

    found = stabilising_design(design, model, weights)

    assert pole_radius(closed_loop(found, model)) < 1.0
    # That of LQG has the command on its way and the disturbance as well.
    more = 2 if design is design_lqg else 0
    assert found.model.nstates == identified_model().nstates + more


@pytest.mark.parametrize(("design", "weights"), DESIGNS)
def test_model_that_the_design_does_not_stabilise___is_refused(
    design: Callable[..., IlqrDesign], weights: RegulatorWeights
) -> None:
    with pytest.raises(SettingError, match=r"^no stabilising design: .* pole of 1\.0[^\n]*$"):
        stabilising_design(design, with_pole(1.01, 1e-6), weights)


def test_compensation___is_that_of_4_8_beside_the_same_effort() -> None:
    design = design_ilqr(identified_model(), replace(IlqrWeights(), ki=0.0))
    plain, compensated = Ilqr(design), Ilqr(design, OptionalCompensation(0.7))

    for reference_v, level_v in ((3.0, 0.7), (-3.0, -0.7), (0.04, 0.0)):
        for law in (plain, compensated):
            law.reset()
        effort_v, none_v = plain.step((0.0,) * 4, reference_v)
        assert none_v == 0.0
        assert compensated.step((0.0,) * 4, reference_v) == pytest.approx((effort_v, level_v))


def test_compensation___does_not_reach_the_observer() -> None:
    """The model is that of the arm whose friction is compensated."""
    design = design_ilqr(identified_model())
    laws = Ilqr(design), Ilqr(design, OptionalCompensation(0.7))

    for k in range(50):
        plain, compensated = (law.step((0.01 * k, 0.0, 0.0, 0.0), 3.0) for law in laws)
        assert plain.effort_v == pytest.approx(compensated.effort_v)
