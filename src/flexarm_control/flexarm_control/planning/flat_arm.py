"""Flat model of the arm: rigid motion with drag and one free mode.

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

from flexarm_core.channels import POSITION_V_PER_RAD, SPEED_V_S_PER_RAD
from flexarm_core.errors import SettingError
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

SPEED_PER_POSITION_S = SPEED_V_S_PER_RAD / POSITION_V_PER_RAD
"""Tachometer signal per rate of the position signal: tau."""

_GAIN = (0.01, 1000.0, "1/s^2", "position signal: acceleration per volt of command")
_DRAG = (0.001, 20.0, "1/s", "decay rate of the speed without friction")
_FREQUENCY = (0.5, 100.0, "Hz", "first bending mode of the arm with free hub")
_SHARE = (0.0, 500.0, "", "part of that mode in the position, over the rigid one's")
_STRAIN = (-5.0, 5.0, "s^2", "middle gauge over the acceleration of the position signal")


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
