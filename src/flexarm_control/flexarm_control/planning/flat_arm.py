"""Flat model of the arm, nominal or identified: rigid motion with drag and one free mode.

With the rigid position r and the mode's part q of the hub, both in volts of the position signal::

    r'' + d r' = g u,    q'' + 2 zeta w q' + w^2 q = r'' + d r'
    y1 = r + rho q,      y3 = mu w^2 q,      y4 = tau y1'

At rest r is the position and nothing else is left: a move ends at rest when r is where it should
be and r', q and q' are zero. `flexarm_control.planning.move` plans such moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.models.arm_model import (
    MIDDLE_STRAIN,
    OUTPUTS,
    POSITION,
    check_arm_model,
)
from flexarm_control.models.rigid_and_bending import bending_modes
from flexarm_core.channels import POSITION_V_PER_RAD, SPEED_V_S_PER_RAD
from flexarm_core.errors import SettingError
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    import control

    from flexarm_core.arrays import ComplexArray, FloatArray

SPEED_PER_POSITION_S = SPEED_V_S_PER_RAD / POSITION_V_PER_RAD
"""Tachometer signal per rate of the position signal: tau."""

_GAIN = (0.01, 1000.0, "1/s^2", "position signal: acceleration per volt of command")
_DRAG = (0.001, 20.0, "1/s", "decay rate of the speed without friction")
_FREQUENCY = (0.5, 100.0, "Hz", "first bending mode of the arm with free hub")
_SHARE = (0.0, 500.0, "", "part of that mode in the position, over the rigid one's")
_STRAIN = (-5.0, 5.0, "s^2", "middle gauge over the acceleration of the position signal")
# Below, an identified response is that of friction; a move has little there.
_FROM_HZ = 0.5
_BEYOND_FIRST = 1.5
_FREQUENCIES = 300
# Gain and drag depend on each other, but hardly.
_FITS = 3
# Part of the position's response, frequency by frequency, that a usable model leaves out at most.
_MOST_MISSED = 0.5


@dataclass(frozen=True)
class FlatArm:
    """Figures of the flat model for one payload.

    Attributes
    ----------
    gain_per_s2 : float
        g, acceleration of the position signal per volt of command, 1/s^2.
    drag_per_s : float
        d, above 0, 1/s.
    frequency_hz, damping_ratio : float
        w / (2 pi) and zeta of the mode with free hub.
    hub_share : float
        rho, the mode's part in the position over that of the rigid motion.
    middle_strain_s2 : float
        mu, middle gauge over the acceleration of the position signal at low frequency, s^2.
    """

    gain_per_s2: float
    drag_per_s: float
    frequency_hz: float
    damping_ratio: float
    hub_share: float
    middle_strain_s2: float

    @property
    def decay_per_s(self) -> float:
        """Decay rate of the mode, zeta w, 1/s."""
        return self.damping_ratio * 2.0 * pi * self.frequency_hz

    @property
    def damped_period_s(self) -> float:
        """Period of the mode as it decays, s."""
        return 1.0 / (self.frequency_hz * sqrt(1.0 - self.damping_ratio**2))

    def step_responses(self, time_s: FloatArray) -> FloatArray:
        """Return r, r', q and q' after a step of 1 V, (4, times)."""
        drag, decay = self.drag_per_s, self.decay_per_s
        damped = 2.0 * pi / self.damped_period_s
        grown = -np.expm1(-drag * time_s) / drag
        swing, cosine = np.exp(-decay * time_s), np.cos(damped * time_s)
        sine = np.sin(damped * time_s) / damped
        mode = (1.0 - swing * (cosine + decay * sine)) / (damped**2 + decay**2)
        return self.gain_per_s2 * np.stack([(time_s - grown) / drag, grown, mode, swing * sine])

    def outputs(self, states: FloatArray) -> FloatArray:
        """Return position, its rate and middle gauge of r, r', q and q', (3, ...)."""
        rigid, rigid_rate, mode, mode_rate = states
        stiffness = (2.0 * pi * self.frequency_hz) ** 2
        return np.stack(
            [
                rigid + self.hub_share * mode,
                rigid_rate + self.hub_share * mode_rate,
                self.middle_strain_s2 * stiffness * mode,
            ]
        )


@dataclass(frozen=True)
class ArmFigures(Bounded):
    """Figures of the flat model at three payloads; the defaults are those of the simulated rig.

    Raises
    ------
    SettingError
        When a value is outside its range, or the payloads do not increase.
    """

    damping_ratio: float = setting(0.037, 0.0, 0.9, "", "damping ratio of the first bending mode")
    light_kg: float = setting(0.0, 0.0, 1.0, "kg", "payload of the light figures")
    light_gain_per_s2: float = setting(17.97, *_GAIN)
    light_drag_per_s: float = setting(0.827, *_DRAG)
    light_frequency_hz: float = setting(9.40, *_FREQUENCY)
    light_hub_share: float = setting(10.5, *_SHARE)
    light_middle_strain_s2: float = setting(-0.0107, *_STRAIN)
    medium_kg: float = setting(0.2, 0.0, 1.0, "kg", "payload of the medium figures")
    medium_gain_per_s2: float = setting(7.711, *_GAIN)
    medium_drag_per_s: float = setting(0.640, *_DRAG)
    medium_frequency_hz: float = setting(7.37, *_FREQUENCY)
    medium_hub_share: float = setting(18.3, *_SHARE)
    medium_middle_strain_s2: float = setting(-0.0331, *_STRAIN)
    heavy_kg: float = setting(0.4, 0.0, 1.0, "kg", "payload of the heavy figures")
    heavy_gain_per_s2: float = setting(4.908, *_GAIN)
    heavy_drag_per_s: float = setting(0.589, *_DRAG)
    heavy_frequency_hz: float = setting(6.99, *_FREQUENCY)
    heavy_hub_share: float = setting(27.7, *_SHARE)
    heavy_middle_strain_s2: float = setting(-0.0555, *_STRAIN)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.light_kg < self.medium_kg < self.heavy_kg:
            payloads_kg = (self.light_kg, self.medium_kg, self.heavy_kg)
            raise SettingError(f"payloads_kg = {payloads_kg} must increase")

    def at(self, payload_kg: float) -> FlatArm:
        """Return the figures for a payload in kg; outside the three, those of the nearest.

        Between two payloads all figures are linear, but the gain, whose reciprocal is the inertia.
        """
        rows = ("light", "medium", "heavy")
        known_kg = [getattr(self, f"{row}_kg") for row in rows]

        def between(name: str, power: int = 1) -> float:
            values = [getattr(self, f"{row}_{name}") ** power for row in rows]
            return float(np.interp(payload_kg, known_kg, values)) ** power

        return FlatArm(
            between("gain_per_s2", -1),
            between("drag_per_s"),
            between("frequency_hz"),
            self.damping_ratio,
            between("hub_share"),
            between("middle_strain_s2"),
        )

    def drag_of(self, gain_per_s2: float) -> float:
        """Return the drag, 1/s, of an arm with a gain, that is: with an inertia."""
        rows = ("light", "medium", "heavy")
        known = [
            (1.0 / getattr(self, f"{row}_gain_per_s2"), getattr(self, f"{row}_drag_per_s"))
            for row in rows
        ]
        inertias, drags_per_s = zip(*sorted(known), strict=True)
        return float(np.interp(1.0 / gain_per_s2, inertias, drags_per_s))


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
