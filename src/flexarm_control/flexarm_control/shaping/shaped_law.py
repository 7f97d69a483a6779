"""Law behind a reference shaper, and the vibration that the shaper is made for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import ceil, isfinite
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.law_protocol import hearing
from flexarm_control.models.arm_model import POSITION
from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
from flexarm_control.models.rigid_and_bending import bending_modes
from flexarm_control.shaping.shapers import LONGEST_PERIODS, Vibration, shaper_parts
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_control.laws.law_protocol import Effort, LawWithMemory, Memory
    from flexarm_control.laws.payload import PayloadEstimate

_NEW_PAYLOAD_KG = 0.02
"""Change of the detected payload that is worth another shaper, kg."""


class ShapedLaw:
    """Law that follows its reference through a shaper.

    Each change of the reference is spread by the shaper in force at that sample, and the spread
    changes add up. So another payload changes later moves only, and nothing jumps.

    After `reset` the first change is the one from the arm's position. Before it, as when the law
    replaces another one in a run, the law begins at the reference that is in force.

    Parameters
    ----------
    law : LawWithMemory
        Law that gets the shaped reference.
    shaper : str
        Key of `flexarm_control.shaping.shapers.SHAPERS`.
    vibrations : Vibrations
        Mode of the arm over the payload.
    rate_hz : float
        Sampling rate, Hz.
    payload_kg : float
        Payload until one is detected, kg.
    payload : callable, optional
        Function that returns the law's estimate of the payload, if it has one.

    Raises
    ------
    SettingError
        When the rate is too low for the vibration.
    """

    def __init__(
        self,
        law: LawWithMemory,
        shaper: str,
        vibrations: Vibrations,
        *,
        rate_hz: float,
        payload_kg: float = 0.0,
        payload: Callable[[], PayloadEstimate] | None = None,
    ) -> None:
        self._law = law
        self.hear = hearing(law)
        self._shaper = shaper
        self._vibrations = vibrations
        self._rate_hz = rate_hz
        self._usual_kg = payload_kg
        self._payload = payload
        frequencies_hz = [mode.frequency_hz for mode in vibrations.modes]
        if max(frequencies_hz) >= 0.5 * rate_hz:
            raise SettingError(
                f"no shaper for a vibration of {max(frequencies_hz):.3g} Hz at {rate_hz:g} samples "
                "a second: sample more than twice a period, or name another model"
            )
        self._to_come_v = np.zeros(ceil(LONGEST_PERIODS * rate_hz / min(frequencies_hz)) + 2)
        self._from_position = False
        self._begin()

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        answer = self._law.step(volts, self._shaped_v(volts[POSITION], reference_v))
        if self._payload is not None:
            estimate = self._payload()
            if estimate.detected and abs(estimate.payload_kg - self._kg) > _NEW_PAYLOAD_KG:
                self._design(estimate.payload_kg)
        return answer

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._law.reset()
        self._from_position = True
        self._begin()

    def memory(self) -> Memory:
        """Return the changes to come, and the memory of the law; see `LawWithMemory.memory`."""
        counts = float(self._left), float(self._started), float(self._from_position)
        return {
            "shaper": (self._reference_v, self._shaped_reference_v, self._kg, *counts),
            "shaper_to_come_v": np.roll(self._to_come_v, -self._at).tolist(),
            **self._law.memory(),
        }

    def remember(self, memory: Memory) -> None:
        """Go on from changes to come and a memory of the law; see `LawWithMemory.remember`."""
        self._reference_v, self._shaped_reference_v, payload_kg, *counts = memory["shaper"]
        self._left, self._started, self._from_position = int(counts[0]), *map(bool, counts[1:])
        self._to_come_v[:] = memory["shaper_to_come_v"]
        self._at = 0
        self._design(payload_kg)
        self._law.remember(memory)

    def _begin(self) -> None:
        self._started = False
        self._reference_v = self._shaped_reference_v = 0.0
        self._to_come_v[:] = 0.0
        self._at = self._left = 0
        self._design(self._usual_kg)

    def _design(self, payload_kg: float) -> None:
        self._kg = payload_kg
        mode = self._vibrations.at(payload_kg)
        self._parts = shaper_parts(self._shaper, mode, 1.0 / self._rate_hz)

    def _shaped_v(self, position_v: float, reference_v: float) -> float:
        """Return the shaped reference; one that is not finite is left to the law, which answers."""
        if not (isfinite(position_v) and isfinite(reference_v)):
            return reference_v
        if not self._started:
            self._started = True
            start_v = position_v if self._from_position else reference_v
            self._reference_v = self._shaped_reference_v = start_v
        if reference_v != self._reference_v:
            places = (self._at + np.arange(len(self._parts))) % len(self._to_come_v)
            self._to_come_v[places] += (reference_v - self._reference_v) * self._parts
            self._reference_v = reference_v
            self._left = max(self._left, len(self._parts))
        if self._left:
            self._shaped_reference_v += float(self._to_come_v[self._at])
            self._to_come_v[self._at] = 0.0
            self._at = (self._at + 1) % len(self._to_come_v)
            self._left -= 1
            if not self._left:
                # Rounding errors of the parts do not stay.
                self._shaped_reference_v = self._reference_v
        return self._shaped_reference_v


@dataclass(frozen=True)
class Vibrations:
    """First bending mode over the payload.

    Attributes
    ----------
    payloads_kg : tuple of float
        Payloads, increasing, kg.
    modes : tuple of Vibration
        One mode per payload.
    """

    payloads_kg: tuple[float, ...]
    modes: tuple[Vibration, ...]

    def at(self, payload_kg: float) -> Vibration:
        """Return the mode for a payload in kg, interpolated; outside, that of the end."""
        frequencies_hz, damping_ratios = zip(*self.modes, strict=True)
        return Vibration(
            float(np.interp(payload_kg, self.payloads_kg, frequencies_hz)),
            float(np.interp(payload_kg, self.payloads_kg, damping_ratios)),
        )


@cache
def nominal_vibrations() -> Vibrations:
    """Return the first bending modes of the printed models of Appendix B."""
    payloads_kg = nominal_payloads_kg()
    return Vibrations(payloads_kg, tuple(_first(nominal_model(each)) for each in payloads_kg))


def model_vibrations(model: control.StateSpace) -> Vibrations:
    """Return the first bending mode of an identified model, for every payload.

    Raises
    ------
    SettingError
        When the model has no bending mode.
    """
    return Vibrations((0.0,), (_first(model),))


def _first(model: control.StateSpace) -> Vibration:
    # The identification is loaded only to make a model.
    from flexarm_ident.models.modes import frequency_and_damping  # noqa: PLC0415

    _, (pole, *_) = bending_modes(model)
    return Vibration(*frequency_and_damping(pole, float(model.dt)))
