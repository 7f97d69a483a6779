"""PDPC law whose gains follow the payload, as estimated from the motion (chapter 5, future work 1).

Gains for one payload settle faster with it than gains for all payloads. The schedule holds gains at
some payloads and interpolates linearly between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from flexarm_control.laws.gains import KD, KP, KSG, PdpGains
from flexarm_control.laws.payload import (
    NO_ESTIMATE,
    PayloadDetection,
    PayloadEstimate,
    PayloadEstimator,
)
from flexarm_control.laws.pdpc import Pdpc
from flexarm_core.errors import SettingError
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.gains import Compensation
    from flexarm_control.laws.law_protocol import Effort, Memory

_ASK_EVERY = 10
_RAMP_S = 0.05
"""Time constant of a change of gains, s, so that the command does not jump."""
_LIGHT = (0.0, 1.0, "kg", "payload of the light gains")
_MEDIUM = (0.0, 1.0, "kg", "payload of the medium gains")
_HEAVY = (0.0, 1.0, "kg", "payload of the heavy gains")


@dataclass(frozen=True)
class GainSchedule:
    """Gains over the payload.

    Attributes
    ----------
    payloads_kg : tuple of float
        Payloads of the gains, increasing, kg.
    gains : tuple of PdpGains
        One set of gains per payload.

    Raises
    ------
    SettingError
        When there is no set, the numbers differ, or the payloads do not increase.
    """

    payloads_kg: tuple[float, ...]
    gains: tuple[PdpGains, ...]

    def __post_init__(self) -> None:
        if not self.gains or len(self.gains) != len(self.payloads_kg):
            raise SettingError(
                f"a schedule needs as many payloads as gains, got {len(self.payloads_kg)} "
                f"and {len(self.gains)}"
            )
        _check_increasing(self.payloads_kg)

    def at(self, payload_kg: float) -> PdpGains:
        """Return the gains for a payload in kg; outside the schedule, those of its end."""
        payloads, gains = self.payloads_kg, self.gains
        if payload_kg <= payloads[0]:
            return gains[0]
        for index in range(1, len(payloads)):
            if payload_kg < payloads[index]:
                share = (payload_kg - payloads[index - 1]) / (payloads[index] - payloads[index - 1])
                return between(gains[index - 1], gains[index], share)
        return gains[-1]


def _check_increasing(payloads_kg: tuple[float, ...]) -> None:
    if any(after <= before for before, after in pairwise(payloads_kg)):
        raise SettingError(f"payloads_kg = {payloads_kg} must increase")


def between(from_gains: PdpGains, to_gains: PdpGains, share: float) -> PdpGains:
    """Return the gains at a share of the way from one set to another."""
    return PdpGains(
        from_gains.kp + share * (to_gains.kp - from_gains.kp),
        from_gains.kd + share * (to_gains.kd - from_gains.kd),
        from_gains.ksg + share * (to_gains.ksg - from_gains.ksg),
    )


@dataclass(frozen=True)
class ScheduleGains(Bounded):
    """Gains of a law that follows the payload.

    The robust gains, in force until the payload is known, are the result of `tune_pdp` for all
    nominal models together, with 10 dB and 55 deg on each. The others settle fastest in trials on
    the simulated rig. They overshoot by at most 5 % and keep the same margins on the nominal model
    of their payload.

    Raises
    ------
    SettingError
        When a value is outside its range, or the payloads do not increase.
    """

    kp: float = setting(0.4903, *KP)
    kd: float = setting(4.3328, *KD)
    ksg: float = setting(0.005, *KSG)
    light_kg: float = setting(0.0, *_LIGHT)
    light_kp: float = setting(0.55, *KP)
    light_kd: float = setting(3.0, *KD)
    light_ksg: float = setting(0.05, *KSG)
    medium_kg: float = setting(0.2, *_MEDIUM)
    medium_kp: float = setting(0.5, *KP)
    medium_kd: float = setting(3.25, *KD)
    medium_ksg: float = setting(0.05, *KSG)
    heavy_kg: float = setting(0.4, *_HEAVY)
    heavy_kp: float = setting(0.45, *KP)
    heavy_kd: float = setting(3.75, *KD)
    heavy_ksg: float = setting(0.0, *KSG)

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_increasing((self.light_kg, self.medium_kg, self.heavy_kg))

    @property
    def robust(self) -> PdpGains:
        """Gains for every payload."""
        return PdpGains(self.kp, self.kd, self.ksg)

    @property
    def schedule(self) -> GainSchedule:
        """Gains over the payload."""
        return GainSchedule(
            (self.light_kg, self.medium_kg, self.heavy_kg),
            (
                PdpGains(self.light_kp, self.light_kd, self.light_ksg),
                PdpGains(self.medium_kp, self.medium_kd, self.medium_ksg),
                PdpGains(self.heavy_kp, self.heavy_kd, self.heavy_ksg),
            ),
        )


class ScheduledPdpc:
    """PDPC law with gains from a schedule.

    The law starts with gains for every payload. Once the payload is detected, the gains change
    gradually to those of the schedule. The last gains stay when the detection is lost.

    Parameters
    ----------
    gains : ScheduleGains
        Robust gains, and gains by payload.
    compensation : Compensation
        Level and thresholds of (4-8).
    detection : PayloadDetection
        Settings of the estimator and of the rig.
    """

    def __init__(
        self, gains: ScheduleGains, compensation: Compensation, detection: PayloadDetection
    ) -> None:
        self._robust = Pdpc(gains.robust, compensation)
        self._schedule = gains.schedule
        self._estimator = PayloadEstimator(detection)
        self._share = min(1.0, 1.0 / (detection.rate_hz * _RAMP_S))
        self._law = self._robust
        self._usual = self._gains = self._wanted = gains.robust
        self._payload = NO_ESTIMATE
        self._samples = 0

    @property
    def payload(self) -> PayloadEstimate:
        """Present estimate of the payload."""
        return self._payload

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        self._estimator.step(volts)
        self._samples += 1
        if self._samples % _ASK_EVERY == 0:
            self._payload = self._estimator.estimate
            if self._payload.detected:
                self._wanted = self._schedule.at(self._payload.payload_kg)
        if self._gains != self._wanted:
            self._gains = between(self._gains, self._wanted, self._share)
            self._law = replace(self._robust, gains=self._gains)
        return self._law.step(volts, reference_v)

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._estimator.reset()
        self._payload = NO_ESTIMATE
        self._samples = 0
        self._law = self._robust
        self._gains = self._wanted = self._usual

    def memory(self) -> Memory:
        """Return estimator and gains; see `LawWithMemory.memory`."""
        gains, wanted = self._gains, self._wanted
        return {
            **self._estimator.memory(),
            "samples": (float(self._samples),),
            "gains": (gains.kp, gains.kd, gains.ksg),
            "wanted_gains": (wanted.kp, wanted.kd, wanted.ksg),
        }

    def remember(self, memory: Memory) -> None:
        """Go on from an estimator and gains; see `LawWithMemory.remember`."""
        self._estimator.remember(memory)
        self._samples = int(memory["samples"][0])
        self._gains = PdpGains(*memory["gains"])
        self._law = replace(self._robust, gains=self._gains)
        self._wanted = PdpGains(*memory["wanted_gains"])
