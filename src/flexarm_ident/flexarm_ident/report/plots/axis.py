"""Axis of a plot: its range, the place of a value on it, and its ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from flexarm_core.arrays import FloatArray

_STEPS = (1.0, 2.0, 5.0, 10.0)
# Ticks of a decade, by the decades of an axis below which they fit. Without a tick near its ends,
# a logarithmic axis is read as a linear one.
_DECADE_TICKS = ((2.0, (1, 2, 3, 5, 7)), (3.0, (1, 2, 5)), (math.inf, (1,)))
_FEWEST_TICKS = 3
_ROOM = 0.05


class SecondUnit(NamedTuple):
    """Another unit of an axis, for ticks at its other side: its name, and its value for 1."""

    unit: str
    per_unit: float


@dataclass(frozen=True)
class Axis:
    """Range of an axis and its label.

    Attributes
    ----------
    label : str
        Quantity and unit.
    low, high : float
        Ends, in the axis's own scale: logarithms to base 10 on a logarithmic axis.
    log : bool
        Whether the axis is logarithmic.
    ticks : int
        About how many ticks a linear axis gets.
    step : float
        Distance of the ticks; 0: chosen.
    second : SecondUnit, optional
        Unit at the other side.
    """

    label: str
    low: float
    high: float
    log: bool = False
    ticks: int = 5
    step: float = 0.0
    second: SecondUnit | None = None

    @classmethod
    def around(
        cls,
        label: str,
        values: Iterable[ArrayLike],
        *,
        log: bool = False,
        ticks: int = 5,
        second: SecondUnit | None = None,
    ) -> Axis:
        """Return an axis that holds the finite ones of all values, with a little room."""
        joined = np.concatenate([np.ravel(np.asarray(each, dtype=np.float64)) for each in values])
        if log:
            joined = np.log10(joined[joined > 0.0])
        known = joined[np.isfinite(joined)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        room = _ROOM * (high - low) or 0.5
        return cls(label, low - room, high + room, log=log, ticks=ticks, second=second)

    @classmethod
    def of_counts(cls, label: str, low: float, high: float) -> Axis:
        """Return an axis with ticks at whole numbers."""
        return cls(label, low, high, ticks=max(1, min(6, int(high - low))))

    def scaled(self, values: ArrayLike) -> FloatArray:
        """Return the places of values: 0 at the low end, 1 at the high one, NaN where none is."""
        array = np.asarray(values, dtype=np.float64)
        if self.log:
            array = np.log10(np.where(array > 0.0, array, np.nan))
        return np.asarray((array - self.low) / (self.high - self.low))

    def marks(self) -> list[tuple[float, str]]:
        """Return the ticks: their places, 0 to 1, and their words."""
        values = self._decades() if self.log else _even(self.low, self.high, self.ticks, self.step)
        return self._placed(values)

    def second_marks(self) -> list[tuple[float, str]]:
        """Return the ticks of the other side; none without a second unit."""
        if self.second is None:
            return []
        per = self.second.per_unit
        values = _even(self.low * per, self.high * per, self.ticks, 0.0)
        return [
            (place, plain(value))
            for value, (place, _) in zip(
                values, self._placed([value / per for value in values]), strict=True
            )
        ]

    def _decades(self) -> list[float]:
        span = self.high - self.low
        factors = next(factors for below, factors in _DECADE_TICKS if span < below)
        found = [
            factor * 10.0**power
            for power in range(math.floor(self.low), math.ceil(self.high) + 1)
            for factor in factors
            if self.low <= math.log10(factor) + power <= self.high
        ]
        if len(found) >= _FEWEST_TICKS:
            return found
        return _even(10.0**self.low, 10.0**self.high, self.ticks, 0.0)

    def _placed(self, values: list[float]) -> list[tuple[float, str]]:
        return [
            (float(place), plain(value))
            for value, place in zip(values, self.scaled(values), strict=True)
        ]


def plain(value: float) -> str:
    """Return a number in few digits, without a power of ten where that is short."""
    return f"{value:.6g}".replace("-", "\u2212")


def _even(low: float, high: float, ticks: int, step: float) -> list[float]:
    """Return the multiples of a round step, or of the given one, within a range."""
    if not step:
        rough = (high - low) / ticks
        power = 10.0 ** math.floor(math.log10(rough))
        step = power * next(each for each in _STEPS if each * power >= 0.999 * rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]
