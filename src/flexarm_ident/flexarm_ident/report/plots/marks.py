"""Marks of a plot: curves, points and areas, each as one SVG path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.arrays import runs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.report.plots.axis import Axis

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
