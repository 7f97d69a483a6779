"""PDP control with Coulomb friction compensation, (4-6) to (4-8), simpler settings, and PI."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING

from flexarm_control.laws.gains import Compensation, Coulomb, PdGains, PdpGains
from flexarm_control.laws.law_protocol import NO_EFFORT, Memoryless, limited, winds_up

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.gains import CompensationLevel, PiGains, Sampling
    from flexarm_control.laws.law_protocol import Effort, Memory


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


class Pi:
    """PI law that evaluates models (Figure 4-1), without friction compensation.

    u_e = kp e + ki dt (e(0) + ... + e(k)), with e = R - y1. The sum is held while the drive is
    saturated, or a limit cut the last effort, and the error would drive it further.

    Parameters
    ----------
    gains : PiGains
        Gains of the law.
    sampling : Sampling
        Sampling rate of the law.
    """

    def __init__(self, gains: PiGains, sampling: Sampling) -> None:
        self._gains = gains
        self._dt_s = 1.0 / sampling.rate_hz
        self._integral_v_s = self._cut_v = 0.0

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        error_v = reference_v - volts[0]
        if not isfinite(error_v):
            return NO_EFFORT
        integral_v_s = self._integral_v_s + self._dt_s * error_v
        effort_v = self._gains.kp * error_v + self._gains.ki * integral_v_s
        answer = limited(effort_v)
        if not winds_up(error_v, effort_v - answer.effort_v, self._cut_v):
            self._integral_v_s = integral_v_s
        return answer

    def hear(self, missing_v: float, cut_v: float) -> None:  # noqa: ARG002 - for observers
        """Hear what was cut off the last effort; see `HearingLaw.hear`."""
        self._cut_v = cut_v

    def reset(self) -> None:
        """Forget the sum of the errors."""
        self._integral_v_s = self._cut_v = 0.0

    def memory(self) -> Memory:
        """Return the sum of the errors; see `LawWithMemory.memory`."""
        return {"integral_v_s": (self._integral_v_s,)}

    def remember(self, memory: Memory) -> None:
        """Go on from a sum of the errors; see `LawWithMemory.remember`."""
        (self._integral_v_s,) = memory["integral_v_s"]
