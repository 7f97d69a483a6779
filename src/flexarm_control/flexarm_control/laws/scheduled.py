"""PDPC whose gains follow the payload that the motion tells (chapter 5, future work 1)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexarm_control.laws.payload import (
    NO_ESTIMATE,
    PayloadDetection,
    PayloadEstimate,
    PayloadEstimator,
)
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.laws.schedule import ScheduleGains, between

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.gains import Compensation
    from flexarm_control.laws.law import Effort

_ASK_EVERY = 10
_RAMP_S = 0.05
"""Time constant of a change of gains: the command moves, it does not jump."""


class ScheduledPdpc:
    """PDPC law with gains from a schedule.

    Starts with gains that hold for every payload. Once the payload is detected, the gains glide to
    those of the schedule; a payload that gets lost again keeps the last ones.

    Parameters
    ----------
    gains
        Robust gains, and gains by payload.
    compensation
        Level and thresholds of (4-8).
    detection
        What the estimator knows of the rig.
    """

    def __init__(
        self, gains: ScheduleGains, compensation: Compensation, detection: PayloadDetection
    ) -> None:
        self._robust = Pdpc(gains.robust, compensation)
        self._schedule = gains.schedule
        self._estimator = PayloadEstimator(detection)
        self._share = min(1.0, 1.0 / (detection.rate_hz * _RAMP_S))
        self._law = self._robust
        self._wanted = gains.robust
        self._payload = NO_ESTIMATE
        self._samples = 0

    @property
    def payload(self) -> PayloadEstimate:
        """The payload as far as it is known."""
        return self._payload

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law.Law.step`."""
        self._estimator.step(volts)
        self._samples += 1
        if self._samples % _ASK_EVERY == 0:
            self._payload = self._estimator.estimate
            if self._payload.detected:
                self._wanted = self._schedule.at(self._payload.payload_kg)
        gains = self._law.gains
        if gains != self._wanted:
            self._law = replace(self._law, gains=between(gains, self._wanted, self._share))
        return self._law.step(volts, reference_v)

    def reset(self) -> None:
        """Forget the past and the payload."""
        self._estimator.reset()
        self._payload = NO_ESTIMATE
        self._samples = 0
        self._law = self._robust
        self._wanted = self._robust.gains
