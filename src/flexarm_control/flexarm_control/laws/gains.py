"""Gains of the control laws, with their ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Sequence

KP = (0.0, 5.0, "V/V", "proportional gain on the position error")
KD = (0.0, 20.0, "V/V", "gain of the speed feedback")
KSG = (-2.0, 2.0, "V/V", "gain of the middle strain gauge")


@dataclass(frozen=True)
class PdGains(Bounded):
    """Gains of the PD law of the closed-loop experiments (section 2.4.3)."""

    kp: float = setting(1.0, *KP)
    kd: float = setting(2.8, *KD)

    def effort_v(self, error_v: float, volts: Sequence[float]) -> float:
        """Return the effort u_e = kp e - kd y4 at an error and the four outputs, all V."""
        return self.kp * error_v - self.kd * volts[3]


@dataclass(frozen=True)
class PdpGains(Bounded):
    """Gains of the PDP law (4-7); the defaults are the optimum of Table 4-2.

    The gain of the middle strain gauge may be negative, since its sign depends on the wiring.
    """

    kp: float = setting(0.5935, *KP)
    kd: float = setting(4.2664, *KD)
    ksg: float = setting(0.2538, *KSG)

    def effort_v(self, error_v: float, volts: Sequence[float]) -> float:
        """Return the effort (4-7) at an error and the four outputs, all V.

        y4 already is the speed; the dot over it in (4-7) is a misprint.
        """
        return self.kp * error_v - self.kd * volts[3] - self.ksg * volts[2]


@dataclass(frozen=True)
class TunedPdpGains(PdpGains):
    """Gains of the PDP law that keep 10 dB and 55 deg on every printed model.

    They are the result of `tune_pdp` for all nominal models together; those of Table 4-2 keep less.
    """

    kp: float = setting(0.4903, *KP)
    kd: float = setting(4.3328, *KD)
    ksg: float = setting(0.005, *KSG)


@dataclass(frozen=True)
class PiGains(Bounded):
    """Gains of the PI law that evaluates models (4-1); the defaults are those of Table 4-1."""

    kp: float = setting(0.3998, *KP)
    ki: float = setting(0.0178, 0.0, 2.0, "1/s", "gain on the integral of the error")


@dataclass(frozen=True)
class Sampling(Bounded):
    """Sampling rate of a law with a memory."""

    rate_hz: float = setting(300.0, 50.0, 2000.0, "Hz", "sampling rate of the rig")


@dataclass(frozen=True)
class Coulomb(Bounded):
    """Unconditional Coulomb friction compensation (section 2.4.3)."""

    compensation_v: float = setting(0.8, 0.0, 10.0, "V", "Coulomb friction compensation level")

    def command_v(self, effort_v: float, error_v: float, speed_v: float) -> float:  # noqa: ARG002 - as (4-8)
        """Return the compensation u_c = c sign(u_e), V: none without an effort."""
        level_v = self.compensation_v
        return level_v if effort_v > 0.0 else -level_v if effort_v else 0.0


@dataclass(frozen=True)
class CompensationLevel(Bounded):
    """Level of the Coulomb friction compensation of a PDP law (4-8), without its conditions."""

    compensation_v: float = setting(0.7, 0.0, 2.0, "V", "Coulomb friction compensation level")

    def command_v(self, effort_v: float, error_v: float, speed_v: float) -> float:  # noqa: ARG002 - as (4-8)
        """Return the compensation u_c in the direction of an effort, V."""
        return self.compensation_v if effort_v >= 0.0 else -self.compensation_v


@dataclass(frozen=True)
class Compensation(CompensationLevel):
    """Conditional Coulomb friction compensation (4-8), with the thesis's thresholds.

    The compensation is off while both the position error and the speed are below their thresholds.
    """

    error_threshold_v: float = setting(0.05, 0.0, 1.0, "V", "position error from which it acts")
    speed_threshold_v: float = setting(0.05, 0.0, 1.0, "V", "speed signal from which it acts")

    def command_v(self, effort_v: float, error_v: float, speed_v: float) -> float:
        """Return the compensation u_c (4-8) at an effort, a position error and a speed, all V."""
        if abs(error_v) < self.error_threshold_v and abs(speed_v) < self.speed_threshold_v:
            return 0.0
        return super().command_v(effort_v, error_v, speed_v)


@dataclass(frozen=True)
class TunedCompensation(Compensation):
    """Conditional Coulomb friction compensation (4-8) with thresholds above the noise.

    They are five and four times the noise of the simulated rig. The thesis's error threshold is the
    whole 5 % of a step of 1 V, and its speed threshold is passed by the noise.
    """

    error_threshold_v: float = setting(0.025, 0.0, 1.0, "V", "position error from which it acts")
    speed_threshold_v: float = setting(0.08, 0.0, 1.0, "V", "speed signal from which it acts")


@dataclass(frozen=True)
class OptionalCompensation(Compensation):
    """Conditional Coulomb friction compensation (4-8) of a law that has none by default."""

    compensation_v: float = setting(
        0.0, 0.0, 2.0, "V", "Coulomb friction compensation level, 0 for none"
    )
