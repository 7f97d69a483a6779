"""PD law with Coulomb friction compensation (section 2.4.3)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from flexarm_control.laws.gains import Coulomb, PdGains
from flexarm_control.laws.law_protocol import Effort, Memoryless, limited

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class Pd(Memoryless):
    """PD law with Coulomb friction compensation of the closed-loop experiments (section 2.4.3).

    u_e = kp (R - y1) - kd y4 and u_c = c sign(u_e), with no compensation at u_e = 0.
    """

    gains: PdGains = field(default_factory=PdGains)
    coulomb: Coulomb = field(default_factory=Coulomb)

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        effort_v = self.gains.kp * (reference_v - volts[0]) - self.gains.kd * volts[3]
        if effort_v == 0.0:
            return Effort(0.0, 0.0)
        level_v = self.coulomb.compensation_v
        return limited(effort_v, level_v if effort_v > 0.0 else -level_v)
