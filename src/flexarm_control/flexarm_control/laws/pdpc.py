"""PDP control with Coulomb friction compensation, (4-6) to (4-8)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from flexarm_control.laws.gains import Compensation, PdpGains
from flexarm_control.laws.law_protocol import Memoryless, limited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import Effort


@dataclass(frozen=True)
class Pdp(Memoryless):
    """PDP law (4-7) without friction compensation.

    u_e = kp (R - y1) - kd y4 - ksg y3; y4 already is the speed, the dot over it in (4-7) is a
    misprint.
    """

    gains: PdpGains = field(default_factory=PdpGains)

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        gains = self.gains
        effort_v = gains.kp * (reference_v - volts[0]) - gains.kd * volts[3] - gains.ksg * volts[2]
        return limited(effort_v)


@dataclass(frozen=True)
class Pdpc(Memoryless):
    """PDP law with conditional Coulomb friction compensation, (4-6) to (4-8).

    Attributes
    ----------
    gains : PdpGains
        Gains of the PDP law (4-7).
    compensation : Compensation
        Level and thresholds of (4-8).
    conditional : bool
        False keeps the compensation on after the set-point is reached, as in Figure 4-10 (c) and
        (d).
    """

    gains: PdpGains = field(default_factory=PdpGains)
    compensation: Compensation = field(default_factory=Compensation)
    conditional: bool = True

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        gains, compensation = self.gains, self.compensation
        error_v, speed_v = reference_v - volts[0], volts[3]
        effort_v = gains.kp * error_v - gains.kd * speed_v - gains.ksg * volts[2]
        if self.conditional:
            return limited(effort_v, compensation.command_v(effort_v, error_v, speed_v))
        level_v = compensation.compensation_v
        return limited(effort_v, level_v if effort_v >= 0.0 else -level_v)
