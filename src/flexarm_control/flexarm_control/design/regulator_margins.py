"""Margins of the loop of a state feedback with observer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.margins import Margins, loop_margins, margin_frequencies_hz, margins
from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.registry import LAWS
from flexarm_control.laws.regulator_loop import closed_loop, controller_model, pole_radius
from flexarm_control.models.arm_model import (
    OUTPUTS,
    check_arm_model,
    check_no_feedthrough,
    delayed,
)
from flexarm_control.models.nominal_models import identified_model
from flexarm_ident.fitting.validation import frequency_response

if TYPE_CHECKING:
    import control

    from flexarm_control.laws.ilqr import IlqrDesign

_PDP = "pdp"


class RegulatorLoop:
    """Loop of one model, for evaluation with many designs; parameters as for `margins`."""

    def __init__(self, model: control.StateSpace, *, delay_s: float = 0.0) -> None:
        check_arm_model(model)
        self.model = delayed(model, delay_s)
        check_no_feedthrough(self.model)
        self._frequency_hz = margin_frequencies_hz(model)
        self._response = frequency_response(self.model, self._frequency_hz)[..., 0]

    def margins(self, design: IlqrDesign) -> Margins:
        """Return gain, phase and disk margins of the loop, opened at the effort.

        All that the controller does comes together in the effort. A factor there changes every
        loop of the controller at once.
        """
        law = controller_model(design)
        gains = frequency_response(law, self._frequency_hz)[:, 0, : len(OUTPUTS)]
        return loop_margins(
            self._frequency_hz,
            -np.sum(gains * self._response, axis=1),
            np.ones(len(self._frequency_hz), dtype=complex),
            stable=pole_radius(closed_loop(design, self.model)) < 1.0,
        )


def packaged_margins(
    law: str, model: control.StateSpace, *, delay_s: float = 0.0
) -> Margins | None:
    """Return the margins of the loop of a law with its own gains, or None for other laws.

    A regulator has the packaged model; one that changes with the payload has no loop of its own.

    Parameters
    ----------
    law : str
        Key of `LAWS`.
    model : control.StateSpace
        Model of the arm.
    delay_s : float
        Loop delay, s.

    Raises
    ------
    SettingError
        When the model is not one of the arm or the delay is negative.
    """
    row = LAWS[law]
    weights = row.settings[0]()
    if row.design is not None and row.packaged is None:
        return RegulatorLoop(model, delay_s=delay_s).margins(
            row.design(identified_model(), weights)
        )
    if row.tuning == _PDP and isinstance(weights, PdpGains):
        return margins(model, weights, delay_s=delay_s)
    return None
