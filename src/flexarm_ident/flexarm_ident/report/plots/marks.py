"""Axes and marks of a plot: curves, points and areas, each as one SVG path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.arrays import runs

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike

    from flexarm_core.arrays import FloatArray

WIDTH, HEIGHT = 10_000, 2_000
"""Size of a plot in the units of its paths, which a page stretches to its own size."""
SOLID, DASHED, DOTTED, THIN, RULE, CUT = "solid", "dashed", "dotted", "thin", "rule", "cut"
"""Looks of lines: three of curves, one behind them, and two of straight lines across the plot."""
DOT, SMALL, SQUARE, SPECK = "dot", "small", "square", "speck"
RING, CORE = "ring", "core"
"""Looks of points."""
SHADE, BAND, AREA = "shade", "band", "filled"
"""Looks of areas."""
HOLE = "hole"
"""Look of short lines."""
# Beyond the plot on all sides, where nothing is seen, numbers stay short.
_FURTHEST = 50_000.0
_LINE, _POINT, _FILL = "M0 6h26", "M13 6h0", "M0 0h26v12h-26z"
_STEPS = (1.0, 2.0, 5.0, 10.0)
# Ticks of a decade, by the decades of an axis below which they fit. Without a tick near its ends,
# a logarithmic axis is read as a linear one.
_DECADE_TICKS = ((2.0, (1, 2, 3, 5, 7)), (3.0, (1, 2, 5)), (math.inf, (1,)))
_FEWEST_TICKS = 3
_ROOM = 0.05


@dataclass(frozen=True, eq=False)
class Mark:
    """Points in the units of both axes, and how they are joined and drawn.

    Attributes
    ----------
    kind : str
        What the points are: ``line``, ``dots``, ``area`` (closed) or ``segments`` (pairs).
    look : str
        Class in the style sheet.
    x, y : ndarray, (points,)
        Points. Without a finite place a line breaks off.
    label : str
        Entry of the legend; marks of one label are shown and hidden together. Empty: none.
    """

    kind: str
    look: str
    x: FloatArray
    y: FloatArray
    label: str = ""

    @property
    def is_read(self) -> bool:
        """Whether its values are read out under the pointer."""
        return self.kind in ("line", "dots")

    @property
    def swatch(self) -> str:
        """Path of its sample in the legend, 26 by 12."""
        return {"dots": _POINT, "area": _FILL}.get(self.kind, _LINE)

    def path(self, x_axis: Axis, y_axis: Axis) -> str:
        """Return the path within `WIDTH` and `HEIGHT`."""
        across, up = x_axis.scaled(self.x), y_axis.scaled(self.y)
        known = np.isfinite(across) & np.isfinite(up)
        places = np.stack([WIDTH * across, HEIGHT * (1.0 - up)], axis=1)
        points = np.rint(np.clip(np.where(known[:, None], places, 0.0), -_FURTHEST, _FURTHEST))
        whole = points.astype(np.int64)
        if self.kind == "dots":
            return "".join(f"M{x} {y}h0" for x, y in whole[known].tolist())
        if self.kind == "segments":
            pairs = whole.reshape(-1, 4)[known.reshape(-1, 2).all(axis=1)]
            return "".join(f"M{x} {y}L{end_x} {end_y}" for x, y, end_x, end_y in pairs.tolist())
        end = "z" if self.kind == "area" else ""
        return "".join(f"{_polyline(whole[start:stop])}{end}" for start, stop in runs(known))


def line(x: ArrayLike, y: ArrayLike, look: str, label: str = "") -> Mark:
    """Return a curve."""
    return Mark("line", look, np.asarray(x, np.float64), np.asarray(y, np.float64), label)


def dots(x: ArrayLike, y: ArrayLike, look: str, label: str = "") -> Mark:
    """Return points."""
    return Mark("dots", look, np.asarray(x, np.float64), np.asarray(y, np.float64), label)


def segments(x: ArrayLike, y: ArrayLike, look: str, label: str = "") -> Mark:
    """Return straight lines from each even point to the next one."""
    return Mark("segments", look, np.asarray(x, np.float64), np.asarray(y, np.float64), label)


def between(x: ArrayLike, low: ArrayLike, high: ArrayLike, look: str, label: str = "") -> Mark:
    """Return the area between two curves over the same `x`."""
    across = np.asarray(x, dtype=np.float64)
    edges = (np.asarray(each, dtype=np.float64) for each in (low, high))
    known_low, known_high = (np.broadcast_to(edge, across.shape) for edge in edges)
    return Mark(
        "area",
        look,
        np.concatenate([across, across[::-1]]),
        np.concatenate([known_low, known_high[::-1]]),
        label,
    )


def verticals(at: Sequence[float], y_axis: Axis, look: str, label: str = "") -> Mark:
    """Return lines across the plot from below to above."""
    return segments(np.repeat(at, 2), np.tile(_ends(y_axis), len(at)), look, label)


def horizontals(at: Sequence[float], x_axis: Axis, look: str, label: str = "") -> Mark:
    """Return lines across the plot from left to right."""
    return segments(np.tile(_ends(x_axis), len(at)), np.repeat(at, 2), look, label)


def _ends(axis: Axis) -> list[float]:
    ends = [axis.low, axis.high]
    return [10.0**end for end in ends] if axis.log else ends


def _polyline(points: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> str:
    """Return a path by differences, which are short numbers; what stands still is left out."""
    (x, y), moves = points[0], np.diff(points, axis=0)
    steps = moves[moves.any(axis=1)].ravel().tolist()
    return f"M{x} {y}l{' '.join(map(str, steps))}" if steps else f"M{x} {y}h0"


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
