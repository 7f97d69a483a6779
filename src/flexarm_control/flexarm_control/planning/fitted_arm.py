"""Flat model of an identified arm."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.models.arm_model import (
    MIDDLE_STRAIN,
    OUTPUTS,
    POSITION,
    check_arm_model,
)
from flexarm_control.models.rigid_and_bending import bending_modes
from flexarm_control.planning.flat_arm import FlatArm
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    import control

    from flexarm_control.planning.flat_arm import ArmFigures
    from flexarm_core.arrays import ComplexArray, FloatArray

# Below, an identified response is that of friction; a move has little there.
_FROM_HZ = 0.5
_BEYOND_FIRST = 1.5
_FREQUENCIES = 300
# Gain and drag depend on each other, but hardly.
_FITS = 3
# Part of the position's response, frequency by frequency, that a usable model leaves out at most.
_MOST_MISSED = 0.5


@dataclass(frozen=True)
class OneArm:
    """Arm whose figures do not depend on the payload: those of an identified model."""

    figures: FlatArm

    def at(self, payload_kg: float) -> FlatArm:  # noqa: ARG002 - as `ArmFigures` has it
        """Return the figures."""
        return self.figures


def fitted_arm(model: control.StateSpace, figures: ArmFigures) -> OneArm:
    """Fit the flat model to the response of an identified model.

    Rigid motion with drag and the bending modes of the model are fitted by least squares to the
    response of the position, relative at every frequency, from 0.5 Hz to beyond the first mode.

    A linear model cannot tell the drag of fast moves. What friction leaves of a record's slow
    motion stands in its place: on the simulated arm, whose drag is 0.6 to 0.8 1/s, a fit of the
    drag ended between 0 and 1.9 1/s, and moves went 10 % too far. So the drag is that of
    `figures` for the inertia that the model shows.

    Parameters
    ----------
    model : control.StateSpace
        Identified model of the arm.
    figures : ArmFigures
        Figures with the drag of arms of some inertias.

    Raises
    ------
    SettingError
        When the model has other signals or no bending mode, or its position is not that of a hub
        that turns freely.
    """
    # The identification is loaded only for a fit.
    from flexarm_ident.fitting.validation import frequency_response  # noqa: PLC0415

    check_arm_model(model)
    modes_hz, poles = bending_modes(model)
    rates_per_s = np.log(poles) / model.dt
    most_hz = min(_BEYOND_FIRST * modes_hz[0], 0.45 / model.dt)
    frequency_hz = np.geomspace(_FROM_HZ, most_hz, _FREQUENCIES)
    response = frequency_response(model, frequency_hz)[..., 0]
    s = 2j * pi * frequency_hz
    # The command is held over a period.
    held = -np.expm1(-s * model.dt) / (s * model.dt)
    bending = [held / (s**2 - 2.0 * rate.real * s + abs(rate) ** 2) for rate in rates_per_s]
    drag_per_s = figures.light_drag_per_s
    for _ in range(_FITS):
        parts = [held / (s * (s + drag_per_s)), *bending]
        (gain, first, *_), missed = _relative_fit(parts, response[:, POSITION])
        drag_per_s = figures.drag_of(gain)
    if not (missed <= _MOST_MISSED and gain > 0.0):
        raise SettingError(
            f"{100 * missed:.3g} % of the model's {OUTPUTS[POSITION]} is not that of a hub that "
            f"turns freely and bends, at most {100 * _MOST_MISSED:.0f} % may be: identify the arm "
            "from a closed-loop experiment, such as C_dat3"
        )
    bends, _ = _relative_fit(bending, response[:, MIDDLE_STRAIN])
    first_per_s = abs(rates_per_s[0])
    return OneArm(
        FlatArm(
            gain_per_s2=float(gain),
            drag_per_s=drag_per_s,
            frequency_hz=float(first_per_s / (2.0 * pi)),
            damping_ratio=float(-rates_per_s[0].real / first_per_s),
            hub_share=max(0.0, float(first / gain)),
            middle_strain_s2=float(np.sum(bends / np.abs(rates_per_s) ** 2) / gain),
        )
    )


def _relative_fit(parts: list[ComplexArray], wanted: ComplexArray) -> tuple[FloatArray, float]:
    """Fit a real sum of responses to another one; return the weights and the relative error."""
    left = np.column_stack(parts) / wanted[:, None]
    # Real and imaginary parts are equations of their own, since the weights are real.
    stacked = np.vstack([left.real, left.imag])
    ones = np.repeat([1.0, 0.0], len(wanted))
    weights = np.linalg.lstsq(stacked, ones, rcond=None)[0]
    error = stacked @ weights - ones
    return weights, float(np.linalg.norm(error) / np.linalg.norm(ones))
