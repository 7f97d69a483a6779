"""Flat model of the arm: rigid motion with drag and one free mode.

With the rigid position r and the mode's part q of the hub, both in volts of the position signal::

    r'' + d r' = g u,    q'' + 2 zeta w q' + w^2 q = r'' + d r'
    y1 = r + rho q,      y3 = mu w^2 q,      y4 = tau y1'

The model is flat [1]_: command and outputs are sums of derivatives of one signal z, which at rest
is the position. A move of z between two points of rest, smooth enough, is one of the whole arm::

    u  = (z'''' + (2 zeta w + d) z''' + (w^2 + 2 zeta w d) z'' + w^2 d z') / (g w^2)
    y1 = z + ((2 zeta w + rho d) z' + (1 + rho) z'') / w^2
    y3 = mu (z'' + d z'),    y4 = tau y1'

References
----------
.. [1] Fliess, M., Levine, J., Martin, P., and Rouchon, P. (1995). Flatness and defect of non-linear
   systems: introductory theory and examples. International Journal of Control 61(6), 1327-1361.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
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
_DRAG = (0.0, 20.0, "1/s", "decay rate of the speed without friction")
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
        d, 1/s.
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

    def command_weights(self) -> FloatArray:
        """Return the weights of z', z'', z''' and z'''' in the command."""
        w, drag = 2.0 * pi * self.frequency_hz, self.drag_per_s
        decay = 2.0 * self.damping_ratio * w
        weights = np.array([w**2 * drag, w**2 + decay * drag, decay + drag, 1.0])
        return weights / (self.gain_per_s2 * w**2)

    def output_weights(self) -> FloatArray:
        """Return the weights of z to z''' in position, middle gauge and speed, (3, 4)."""
        w = 2.0 * pi * self.frequency_hz
        first = (2.0 * self.damping_ratio * w + self.hub_share * self.drag_per_s) / w**2
        second = (1.0 + self.hub_share) / w**2
        bend, tau = self.middle_strain_s2, SPEED_PER_POSITION_S
        return np.array(
            [
                [1.0, first, second, 0.0],
                [0.0, bend * self.drag_per_s, bend, 0.0],
                [0.0, tau, tau * first, tau * second],
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
