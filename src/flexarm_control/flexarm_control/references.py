"""Position references as pure functions of time, so that a run can be repeated exactly."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

import numpy as np

from flexarm_core.channels import TRAVEL_DEG, TRAVEL_V
from flexarm_core.errors import SettingError
from flexarm_core.specs import (
    Bounded,
    ParameterSpec,
    parameter_specs,
    refuse_unknown,
    select,
    setting,
)
from flexarm_core.waves import Band, multisine

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

# Sample instants k * dt have rounding errors; a switch within this time counts as past.
_ROUNDING_S = 1e-9
_HALF_PERIODS = 1024
_HALF = 0.5

_AMPLITUDE = (-TRAVEL_V, TRAVEL_V, "V", f"position to go to; the travel is +-{TRAVEL_DEG:g} deg")


class Reference(Protocol):
    """Position reference: the same time always gives the same value."""

    def __call__(self, time_s: float) -> float:
        """Return the reference in V at a time since the start in s."""


@dataclass(frozen=True)
class Constant(Bounded):
    """Constant position."""

    amplitude_v: float = setting(0.0, *_AMPLITUDE)

    def __call__(self, time_s: float) -> float:  # noqa: ARG002 - the Reference protocol has it
        """Return the reference in V at a time since the start in s."""
        return self.amplitude_v


@dataclass(frozen=True)
class Step(Bounded):
    """Zero first, then a constant position."""

    amplitude_v: float = setting(3.0, *_AMPLITUDE)
    at_s: float = setting(0.0, 0.0, 3600.0, "s", "instant of the step")

    def __call__(self, time_s: float) -> float:
        """Return the reference in V at a time since the start in s."""
        return self.amplitude_v if time_s + _ROUNDING_S >= self.at_s else 0.0


@dataclass(frozen=True)
class _Wave(Bounded):
    """Wave of one amplitude around an offset.

    Raises
    ------
    SettingError
        When a value is outside its range or the wave leaves the travel.
    """

    amplitude_v: float = setting(3.0, *_AMPLITUDE)
    period_s: float = setting(10.0, 0.1, 3600.0, "s", "full period")
    offset_v: float = setting(0.0, -TRAVEL_V, TRAVEL_V, "V", "middle of the wave")

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.amplitude_v) + abs(self.offset_v) > TRAVEL_V:
            raise SettingError(
                f"{type(self).__name__}: amplitude_v = {self.amplitude_v:g} around offset_v = "
                f"{self.offset_v:g} leaves the travel of +-{TRAVEL_V:.3f} V; make one smaller"
            )

    def _phase(self, time_s: float) -> float:
        """Return the part of the period that has passed, 0 to 1."""
        return (time_s + _ROUNDING_S) % self.period_s / self.period_s


@dataclass(frozen=True)
class Square(_Wave):
    """Square wave between plus and minus the amplitude (Figure 2-14)."""

    def __call__(self, time_s: float) -> float:
        """Return the reference in V at a time since the start in s."""
        sign = 1.0 if self._phase(time_s) < _HALF else -1.0
        return self.offset_v + sign * self.amplitude_v


@dataclass(frozen=True)
class Sine(_Wave):
    """Sine wave, which begins in its middle and rises."""

    def __call__(self, time_s: float) -> float:
        """Return the reference in V at a time since the start in s."""
        return self.offset_v + self.amplitude_v * math.sin(math.tau * self._phase(time_s))


@dataclass(frozen=True)
class Triangle(_Wave):
    """Triangle wave, which begins in its middle and rises."""

    def __call__(self, time_s: float) -> float:
        """Return the reference in V at a time since the start in s."""
        turned = (self._phase(time_s) + 0.25) % 1.0
        return self.offset_v + self.amplitude_v * (1.0 - 4.0 * abs(turned - _HALF))


@dataclass(frozen=True)
class VaryingSquare(Bounded):
    """Square wave with half-periods of random length, as in the experiment C_dat3 (Table A-3).

    The half-periods are uniformly distributed. The wave repeats itself after 1024 of them.

    Raises
    ------
    SettingError
        When a value is outside its range or the shortest half-period exceeds the longest.
    """

    amplitude_v: float = setting(3.0, *_AMPLITUDE)
    shortest_s: float = setting(2.5, 0.05, 3600.0, "s", "shortest half-period")
    longest_s: float = setting(5.0, 0.05, 3600.0, "s", "longest half-period")
    seed: int = setting(0, 0, 2**31 - 1, "", "seed of the half-periods")
    switches_s: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shortest_s > self.longest_s:
            raise SettingError(
                f"VaryingSquare: shortest_s = {self.shortest_s:g} exceeds longest_s = "
                f"{self.longest_s:g}; exchange them"
            )
        lengths_s = np.random.default_rng(self.seed).uniform(
            self.shortest_s, self.longest_s, _HALF_PERIODS
        )
        object.__setattr__(self, "switches_s", tuple(np.cumsum(lengths_s).tolist()))

    def __call__(self, time_s: float) -> float:
        """Return the reference in V at a time since the start in s."""
        half_periods = bisect_right(self.switches_s, (time_s + _ROUNDING_S) % self.switches_s[-1])
        return self.amplitude_v if half_periods % 2 == 0 else -self.amplitude_v


@dataclass(frozen=True)
class Multisine(Bounded):
    """Multisine of odd lines with equal power in each octave.

    With a soft law it drives the arm, and the law keeps its place. The law's gain of the set-point
    makes it a command, and so it may lie beyond the travel.
    """

    magnitude_v: float = setting(1.0, 0.0, 1e6, "V", "peak; times the law's kp it is a command")
    low_hz: float = setting(0.2, 0.001, 5000.0, "Hz", "lowest frequency of the band")
    high_hz: float = setting(50.0, 0.001, 5000.0, "Hz", "highest frequency of the band")
    period_s: float = setting(10.0, 0.01, 3600.0, "s", "period")
    seed: int = setting(0, 0, 2**31 - 1, "", "seed of the phases")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._wave  # noqa: B018 - a band without lines is refused

    @cached_property
    def _wave(self) -> Callable[[float], float]:
        band = Band(self.low_hz, self.high_hz, self.period_s, odd=True, octaves=True)
        return multisine(band, self.seed)

    def __call__(self, time_s: float) -> float:
        """Return the reference in V at a time since the start in s."""
        return self.magnitude_v * self._wave(time_s)


@dataclass(frozen=True)
class ReferenceSpec:
    """Row of one reference: a sentence for a user, the parameters and the class."""

    description: str
    kind: type[Constant | Step | Square | Sine | Triangle | VaryingSquare | Multisine]

    @property
    def parameters(self) -> tuple[ParameterSpec, ...]:
        """Table of all parameters."""
        return parameter_specs(self.kind)


#: Every reference by the name it has as a ROS parameter.
REFERENCES: Mapping[str, ReferenceSpec] = MappingProxyType(
    {
        "constant": ReferenceSpec("constant position", Constant),
        "step": ReferenceSpec("zero, then a constant position", Step),
        "square": ReferenceSpec("square wave between plus and minus the amplitude", Square),
        "sine": ReferenceSpec("sine wave", Sine),
        "triangle": ReferenceSpec("triangle wave", Triangle),
        "varying_square": ReferenceSpec(
            "square wave with random half-periods (C_dat3)", VaryingSquare
        ),
        "multisine": ReferenceSpec("multisine of a band, with a soft controller", Multisine),
    }
)


def build_reference(name: str, values: Mapping[str, float] | None = None) -> Reference:
    """Build a reference from its name and parameters.

    Parameters
    ----------
    name : str
        Key of `REFERENCES`.
    values : mapping of str to float, optional
        Parameters that differ from their defaults.

    Returns
    -------
    Reference
        Reference as a function of time.

    Raises
    ------
    SettingError
        When the reference or a parameter is unknown, or a value is outside its range.
    """
    if name not in REFERENCES:
        raise SettingError(f"no reference {name!r}; choose one of {', '.join(REFERENCES)}")
    values = values or {}
    refuse_unknown(name, REFERENCES[name].parameters, values)
    return select(REFERENCES[name].kind, values)
