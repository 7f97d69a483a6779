"""PDP control with Coulomb friction compensation, (4-6) to (4-8), and its simpler settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from flexarm_control.laws.gains import Compensation, Coulomb, PdGains, PdpGains
from flexarm_control.laws.law_protocol import Memoryless, limited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.gains import CompensationLevel
    from flexarm_control.laws.law_protocol import Effort


@dataclass(frozen=True)
class Pdpc(Memoryless):
    """PDP law with Coulomb friction compensation, (4-6) to (4-8).

    Attributes
    ----------
    gains : PdpGains or PdGains
        Gains of the PDP law (4-7), or of the PD law of section 2.4.3.
    compensation : Compensation, CompensationLevel, Coulomb or None
        Level and thresholds of (4-8); a level alone stays on after the set-point is reached, as in
        Figure 4-10 (c) and (d); None for no compensation.
    """

    gains: PdpGains | PdGains = field(default_factory=PdpGains)
    compensation: CompensationLevel | Coulomb | None = field(default_factory=Compensation)

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        error_v, compensation = reference_v - volts[0], self.compensation
        effort_v = self.gains.effort_v(error_v, volts)
        if compensation is None:
            return limited(effort_v)
        return limited(effort_v, compensation.command_v(effort_v, error_v, volts[3]))


@dataclass(frozen=True)
class Pdp(Pdpc):
    """PDP law (4-7) without friction compensation."""

    compensation: None = None


@dataclass(frozen=True)
class Pd(Pdpc):
    """PD law with the compensation of the closed-loop experiments (section 2.4.3)."""

    gains: PdGains = field(default_factory=PdGains)
    compensation: Coulomb = field(default_factory=Coulomb)
