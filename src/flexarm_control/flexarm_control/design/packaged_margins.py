"""Margins of a law as it is packaged, on a model that it was not designed on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_control.design.margins import Margins, margins
from flexarm_control.design.regulator_margins import RegulatorLoop
from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.registry import LAWS
from flexarm_control.models.nominal_models import identified_model

if TYPE_CHECKING:
    import control

_PDP = "pdp"


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
