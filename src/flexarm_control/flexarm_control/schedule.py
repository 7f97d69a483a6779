"""PDP gains that follow the payload (chapter 5, future work 1).

Gains for one payload settle faster on it than gains that must hold for all of them. The schedule
holds gains at some payloads and runs straight between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from flexarm_control.errors import ControlError
from flexarm_control.gains import PdpGains


@dataclass(frozen=True)
class GainSchedule:
    """Gains over the payload.

    Attributes
    ----------
    payloads_kg
        Payloads of the gains, increasing.
    gains
        Gains, one set per payload.

    Raises
    ------
    ControlError
        When there is no set, the numbers differ, or the payloads do not increase.
    """

    payloads_kg: tuple[float, ...]
    gains: tuple[PdpGains, ...]

    def __post_init__(self) -> None:
        if not self.gains or len(self.gains) != len(self.payloads_kg):
            raise ControlError(
                f"a schedule needs as many payloads as gains, got {len(self.payloads_kg)} "
                f"and {len(self.gains)}"
            )
        if any(after <= before for before, after in pairwise(self.payloads_kg)):
            raise ControlError(f"payloads_kg = {self.payloads_kg} must increase")

    def at(self, payload_kg: float) -> PdpGains:
        """Gains for a payload; beyond the ends, those of the end."""
        payloads, gains = self.payloads_kg, self.gains
        if payload_kg <= payloads[0]:
            return gains[0]
        for index in range(1, len(payloads)):
            if payload_kg < payloads[index]:
                share = (payload_kg - payloads[index - 1]) / (payloads[index] - payloads[index - 1])
                return between(gains[index - 1], gains[index], share)
        return gains[-1]


def between(from_gains: PdpGains, to_gains: PdpGains, share: float) -> PdpGains:
    """Gains a share of the way from one set to another."""
    return PdpGains(
        from_gains.kp + share * (to_gains.kp - from_gains.kp),
        from_gains.kd + share * (to_gains.kd - from_gains.kd),
        from_gains.ksg + share * (to_gains.ksg - from_gains.ksg),
    )


ROBUST = PdpGains(0.4903, 4.3328, 0.005)
"""What `tune_pdp` finds for all nominal models together, with 10 dB and 55 deg on each."""

FASTEST = GainSchedule(
    (0.0, 0.2, 0.4),
    (PdpGains(0.55, 3.0, 0.05), PdpGains(0.5, 3.25, 0.05), PdpGains(0.45, 3.75, 0.0)),
)
"""Gains that settle fastest in trials on the simulated rig, among those that overshoot by at most
5 % and keep 10 dB and 55 deg on the nominal model of their payload."""
