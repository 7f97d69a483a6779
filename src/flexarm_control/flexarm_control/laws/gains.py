"""Gains of the control laws, with their ranges."""

from __future__ import annotations

from dataclasses import dataclass, field

from flexarm_core.specs import Bounded, limits

KP = limits(0.0, 5.0, "V/V", "proportional gain on the position error")
KD = limits(0.0, 20.0, "V/V", "gain of the speed feedback")
KSG = limits(-2.0, 2.0, "V/V", "gain of the middle strain gauge")


@dataclass(frozen=True)
class PdGains(Bounded):
    """Gains of the PD law of the closed-loop experiments (section 2.4.3).

    Attributes
    ----------
    kp
        Gain on the position error, V/V.
    kd
        Gain of the speed feedback, V/V.
    """

    kp: float = field(default=1.0, metadata=KP)
    kd: float = field(default=2.8, metadata=KD)


@dataclass(frozen=True)
class PdpGains(Bounded):
    """Gains of the PDP law (4-7); the defaults are the optimum of Table 4-2.

    Attributes
    ----------
    kp
        Gain on the position error, V/V.
    kd
        Gain of the speed feedback, V/V.
    ksg
        Gain of the middle strain gauge feedback, V/V. Negative values are allowed: the sign of
        the gauge depends on how it is wired.
    """

    kp: float = field(default=0.5935, metadata=KP)
    kd: float = field(default=4.2664, metadata=KD)
    ksg: float = field(default=0.2538, metadata=KSG)


@dataclass(frozen=True)
class PiGains(Bounded):
    """Gains of the PI law that evaluates models (4-1); the defaults are those of Table 4-1.

    Attributes
    ----------
    kp
        Gain on the position error, V/V.
    ki
        Gain on the integral of the position error, V/(V s).
    """

    kp: float = field(default=0.3998, metadata=KP)
    ki: float = field(
        default=0.0178, metadata=limits(0.0, 2.0, "1/s", "gain on the integral of the error")
    )


@dataclass(frozen=True)
class Sampling(Bounded):
    """Sampling rate of a law with a memory.

    Attributes
    ----------
    rate_hz
        Sampling rate, Hz; that of the rig.
    """

    rate_hz: float = field(
        default=300.0, metadata=limits(50.0, 2000.0, "Hz", "sampling rate of the rig")
    )


@dataclass(frozen=True)
class Coulomb(Bounded):
    """Unconditional Coulomb friction compensation (section 2.4.3).

    Attributes
    ----------
    compensation_v
        Level that follows the sign of the effort, V.
    """

    compensation_v: float = field(
        default=0.8, metadata=limits(0.0, 2.0, "V", "level of the Coulomb friction compensation")
    )


@dataclass(frozen=True)
class CompensationLevel(Bounded):
    """Level of the Coulomb friction compensation of a PDP law (4-8), without its conditions.

    Attributes
    ----------
    compensation_v
        Level that follows the sign of the effort, V.
    """

    compensation_v: float = field(
        default=0.7, metadata=limits(0.0, 2.0, "V", "level of the Coulomb friction compensation")
    )


@dataclass(frozen=True)
class Compensation(CompensationLevel):
    """Conditional Coulomb friction compensation (4-8).

    Attributes
    ----------
    compensation_v
        Level that follows the sign of the effort, V.
    error_threshold_v, speed_threshold_v
        The compensation is off while both the position error and the speed are smaller, V.
    """

    error_threshold_v: float = field(
        default=0.05,
        metadata=limits(0.0, 1.0, "V", "position error from which the compensation acts"),
    )
    speed_threshold_v: float = field(
        default=0.05,
        metadata=limits(0.0, 1.0, "V", "speed signal from which the compensation acts"),
    )
