"""Loop of a state feedback with observer, and that of a law by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_control.design.margins import Loop, LoopResponse, margin_frequencies_hz
from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.registry import LAWS
from flexarm_control.laws.regulator_loop import (
    closed_loop,
    controller_model,
    pole_radius,
    stabilising_design,
)
from flexarm_control.models.arm_model import (
    OUTPUTS,
    check_arm_model,
    check_no_feedthrough,
    delayed,
)
from flexarm_control.models.nominal_models import identified_model
from flexarm_core.specs import select
from flexarm_ident.fitting.validation import frequency_response

if TYPE_CHECKING:
    from collections.abc import Mapping

    import control

    from flexarm_control.design.margins import Margins
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

    def loop(self, design: IlqrDesign) -> Loop:
        """Return the loop, opened at the effort.

        All that the controller does comes together in the effort. A factor there changes every
        loop of the controller at once.
        """
        law = controller_model(design)
        gains = frequency_response(law, self._frequency_hz)[:, 0, : len(OUTPUTS)]
        return Loop(
            self._frequency_hz,
            -np.sum(gains * self._response, axis=1),
            np.ones(len(self._frequency_hz), dtype=complex),
            stable=pole_radius(closed_loop(design, self.model)) < 1.0,
        )

    def margins(self, design: IlqrDesign) -> Margins:
        """Return gain, phase and disk margins of the loop."""
        return self.loop(design).margins()


def law_loop(
    law: str,
    model: control.StateSpace,
    values: Mapping[str, Any] | None = None,
    *,
    delay_s: float = 0.0,
) -> Loop | None:
    """Return the loop of a law on a model, or None for a law without one loop of its own.

    A regulator as packaged has the packaged model; one that changes with the payload has no loop.

    Parameters
    ----------
    law : str
        Key of `LAWS`.
    model : control.StateSpace
        Model of the arm.
    values : mapping, optional
        Parameters of a regulator that is designed on this model, or of a PDP law. None: those of
        the packaged law.
    delay_s : float
        Loop delay, s.

    Raises
    ------
    SettingError
        When the model is not one of the arm, the delay is negative or there is no stabilising
        design.
    """
    row = LAWS[law]
    weights: Any = select(row.settings[0], values or {})
    if row.design is not None and values is not None:
        design = stabilising_design(row.design, model, weights)
    elif row.design is not None and row.packaged is None:
        design = row.design(identified_model(), weights)
    elif row.tuning == _PDP and isinstance(weights, PdpGains):
        return LoopResponse(model, delay_s=delay_s).loop(weights)
    else:
        return None
    return RegulatorLoop(model, delay_s=delay_s).loop(design)
