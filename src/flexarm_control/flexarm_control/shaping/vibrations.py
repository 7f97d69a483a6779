"""Vibration of the arm that a shaper is made for: of a model, or nominal for a payload."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
from flexarm_control.models.rigid_and_bending import bending_modes
from flexarm_control.shaping.shapers import Vibration

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class Vibrations:
    """First bending mode over the payload.

    Attributes
    ----------
    payloads_kg : tuple of float
        Payloads, increasing, kg.
    modes : tuple of Vibration
        One mode per payload.
    """

    payloads_kg: tuple[float, ...]
    modes: tuple[Vibration, ...]

    def at(self, payload_kg: float) -> Vibration:
        """Return the mode for a payload in kg, interpolated; outside, that of the end."""
        frequencies_hz, damping_ratios = zip(*self.modes, strict=True)
        return Vibration(
            float(np.interp(payload_kg, self.payloads_kg, frequencies_hz)),
            float(np.interp(payload_kg, self.payloads_kg, damping_ratios)),
        )


@cache
def nominal_vibrations() -> Vibrations:
    """Return the first bending modes of the printed models of Appendix B."""
    payloads_kg = nominal_payloads_kg()
    return Vibrations(payloads_kg, tuple(_first(nominal_model(each)) for each in payloads_kg))


def model_vibrations(model: control.StateSpace) -> Vibrations:
    """Return the first bending mode of an identified model, for every payload.

    Raises
    ------
    SettingError
        When the model has no bending mode.
    """
    return Vibrations((0.0,), (_first(model),))


def _first(model: control.StateSpace) -> Vibration:
    # The identification is loaded only to make a model.
    from flexarm_ident.models.modes import frequency_and_damping  # noqa: PLC0415

    _, (pole, *_) = bending_modes(model)
    return Vibration(*frequency_and_damping(pole, float(model.dt)))
