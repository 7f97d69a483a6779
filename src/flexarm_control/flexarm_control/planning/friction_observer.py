"""Friction that the compensation of a plan does not cover, seen by the base gauge.

The gauge measures the torque that the arm takes and the tachometer the motion of the hub. What is
left of the command is friction, all in volts of command, with u_c the compensation that is known::

    d = u - u_c - beta y2 - h y4' - v y4

A low-pass takes the noise and the derivative. At 5 Hz it follows friction; at 15 Hz the loop hunts.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi
from typing import TYPE_CHECKING

from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Sequence

_BASE_STRAIN, _SPEED = 1, 3


@dataclass(frozen=True)
class FrictionSensing(Bounded):
    """Settings of the observer; the defaults are those of the simulated rig.

    Gain of gauge, tachometer and motor give the weights: beta is one over the gains of base gauge
    and motor, h the inertia of motor and hub and v the viscous friction over the gains of
    tachometer and motor.
    """

    observer_hz: float = setting(
        0.0, 0.0, 50.0, "Hz", "bandwidth of the friction observer; 0: none; try 5"
    )
    command_per_strain: float = setting(1.136, -100.0, 100.0, "V/V", "command that a strain takes")
    command_per_acceleration_s: float = setting(
        0.0235, 0.0, 10.0, "s", "command that accelerates the hub alone, over the change of speed"
    )
    command_per_speed: float = setting(0.451, 0.0, 100.0, "V/V", "viscous friction of the motor")
    most_friction_v: float = setting(1.0, 0.0, 5.0, "V", "most that the observer adds")


class FrictionObserver:
    """Low-pass of the friction beyond a compensation, V.

    Parameters
    ----------
    sensing : FrictionSensing
        Settings.
    rate_hz : float
        Sampling rate of the signals, Hz.

    Attributes
    ----------
    state : tuple of float
        Command that is left, speed, both after the low-pass, and the command in force, V.
    """

    def __init__(self, sensing: FrictionSensing, rate_hz: float) -> None:
        self._sensing = sensing
        pole_per_s = 2.0 * pi * sensing.observer_hz
        self._share = 1.0 - exp(-pole_per_s / rate_hz)
        self._inertia = sensing.command_per_acceleration_s * pole_per_s
        self.state: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def step(self, volts: Sequence[float], effort_v: float) -> float:
        """Return the friction at a sample.

        Parameters
        ----------
        volts : sequence of float
            Position, base strain, middle strain and speed, V.
        effort_v : float
            Effort that answers the sample, V, without the compensation that is known.
        """
        sensing, share = self._sensing, self._share
        if not share:
            return 0.0
        left_v, low_speed_v, command_v = self.state
        base_v, speed_v = volts[_BASE_STRAIN], volts[_SPEED]
        now_v = command_v - (
            sensing.command_per_strain * base_v + sensing.command_per_speed * speed_v
        )
        left_v += share * (now_v - left_v)
        low_speed_v += share * (speed_v - low_speed_v)
        friction_v = left_v - self._inertia * (speed_v - low_speed_v)
        friction_v = min(max(friction_v, -sensing.most_friction_v), sensing.most_friction_v)
        self.state = left_v, low_speed_v, effort_v + friction_v
        return friction_v

    def correct(self, missing_v: float) -> None:
        """Take note that the last effort was another one by so much, V."""
        if self._share:
            left_v, low_speed_v, command_v = self.state
            self.state = left_v, low_speed_v, command_v + missing_v

    def reset(self) -> None:
        """Forget the friction."""
        self.state = (0.0, 0.0, 0.0)
