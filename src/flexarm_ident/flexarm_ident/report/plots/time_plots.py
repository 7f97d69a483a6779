"""Time plots: an output as measured and as simulated, an input, and a controlled motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.arrays import runs
from flexarm_core.channels import CHANNEL_NAMES, CHANNELS
from flexarm_core.labels import axis_label, label_and_unit
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.marks import Axis, SecondUnit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.report.plots.marks import Mark

CURVE_POINTS = 2000
_SHOWN_HOLES = 200
_HIGH, _LOW = "height:11rem", "height:7rem"
_TICKS = 6
_LOOKS = (marks.SOLID, marks.DASHED, marks.DOTTED)
_PER_RADIAN = math.degrees(1.0)
_SHOWN_AS = {
    "N m": ("N m", 1.0),
    "rad": ("deg", _PER_RADIAN),
    "rad/s": ("deg/s", _PER_RADIAN),
}
ARM_UNITS = {
    channel.name: SecondUnit(unit, factor * channel.to_si(1.0))
    for channel in CHANNELS
    for unit, factor in (_SHOWN_AS[channel.si_unit],)
}
"""What the voltages of the arm stand for."""


@dataclass(frozen=True, eq=False)
class Match:
    """An output as measured and as simulated.

    Attributes
    ----------
    name : str
        Name of the output, with its unit at the end.
    time_s, measured, simulated : ndarray, (samples,)
        Time and output. Where the measured one is NaN it breaks off, and a bar at the bottom marks
        the hole. An unstable simulation is cut off one range beyond the measured signal.
    second : SecondUnit, optional
        What the output stands for.
    """

    name: str
    time_s: FloatArray
    measured: FloatArray
    simulated: FloatArray
    second: SecondUnit | None = None


def match_plot(match: Match, *, fitted_s: float, near: slice, points: int = CURVE_POINTS) -> str:
    """Plot a simulated output over the measured one, as Figures 2-7 and 2-8 do.

    A part of the record stands beside the whole, with every sample.

    Parameters
    ----------
    match : Match
        The output: solid as measured, dashed as simulated.
    fitted_s : float
        End of the fitted part, which is shaded.
    near : slice
        Rows of the part, see `liveliest`.
    points : int
        Most points of a curve; a longer record is drawn by its extremes.
    """
    views = [slice(0, len(match.time_s))]
    if near.stop - near.start < len(match.time_s):
        views.append(near)
    return chart(*(_match_view(match, rows, points, fitted_s) for rows in views))


def near_plot(match: Match, near: slice) -> str:
    """Plot the part alone that `match_plot` shows beside the whole."""
    return chart(_match_view(match, near, CURVE_POINTS, 0.0))


def overlay_plot(
    time_s: FloatArray,
    measured: FloatArray,
    simulated: Mapping[str, FloatArray],
    name: str,
    *,
    near: slice,
) -> str:
    """Plot a part of an output as measured and as up to three models simulate it.

    Parameters
    ----------
    time_s, measured : ndarray, (samples,)
        Time and the output.
    simulated : mapping of str to ndarray, (samples,)
        Simulated outputs by the names of their models.
    name : str
        Name of the output, with its unit at the end.
    near : slice
        Rows of the part.
    """
    curves = [_curve(time_s[near], measured[near], marks.THIN, "measured", CURVE_POINTS)]
    for (label, values), look in zip(simulated.items(), _LOOKS, strict=False):
        seen = limited(values, measured)[near]
        curves.append(_curve(time_s[near], seen, look, label, CURVE_POINTS))
    y = Axis.around(axis_label(name), (curve.y for curve in curves))
    words = f"{label_and_unit(name)[0]}: measured, and simulated by {', '.join(simulated)}"
    return chart(View(words, _time(time_s[near]), [Panel(y, curves, _HIGH)]))


def liveliest(outputs: FloatArray, samples: int) -> slice:
    """Return the rows of the part of a record in which its outputs vary most.

    Parameters
    ----------
    outputs : ndarray, (samples, outputs)
        Outputs without NaN; each counts by its variance in the whole record.
    samples : int
        Length of the part.
    """
    if len(outputs) <= samples:
        return slice(0, len(outputs))
    centred = outputs - outputs.mean(axis=0)
    scale = np.sqrt(np.mean(centred**2, axis=0))
    scaled = centred / np.where(scale > 0.0, scale, 1.0)
    sums = np.cumsum(np.pad(scaled, ((1, 0), (0, 0))), axis=0)
    squares = np.cumsum(np.pad(scaled**2, ((1, 0), (0, 0))), axis=0)
    starts = np.arange(0, len(outputs) - samples + 1, max(1, samples // 20))
    mean = (sums[starts + samples] - sums[starts]) / samples
    variance = (squares[starts + samples] - squares[starts]) / samples - mean**2
    start = int(starts[variance.sum(axis=1).argmax()])
    return slice(start, start + samples)


def _match_view(match: Match, rows: slice, points: int, fitted_s: float) -> View:
    """Return both curves over some rows."""
    time_s, measured = match.time_s[rows], match.measured[rows]
    simulated = limited(match.simulated, match.measured)[rows]
    curves = [
        _curve(time_s, measured, marks.SOLID, "measured", points),
        _curve(time_s, simulated, marks.DASHED, "simulated", points),
    ]
    y = Axis.around(
        axis_label(match.name), (curve.y for curve in curves), ticks=_TICKS, second=match.second
    )
    panel = Panel(y, [*_beneath(time_s, np.isnan(measured), y, fitted_s), *curves], _HIGH)
    part = "" if len(time_s) == len(match.time_s) else ", a part of it"
    words = f"{label_and_unit(match.name)[0]}: measured and simulated over time{part}"
    return View(words, _time(time_s), [panel])


def limited(simulated: FloatArray, measured: FloatArray) -> FloatArray:
    """Cut an unstable simulation, (samples,), off one range beyond the measured signal."""
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    span = (high - low) or 1.0
    return np.asarray(np.nan_to_num(simulated, nan=high + span).clip(low - span, high + span))


def _beneath(time_s: FloatArray, missing: BoolArray, y: Axis, fitted_s: float) -> list[Mark]:
    """Return the shade of the fitted part, and bars along the bottom where nothing was measured.

    Of many holes the longest are shown only.
    """
    found = []
    end_s = min(fitted_s, float(time_s[-1]))
    # A shade over all shows nothing.
    if time_s[0] < end_s < time_s[-1]:
        ends_s = [float(time_s[0]), end_s]
        found.append(marks.between(ends_s, y.low, y.high, marks.SHADE, "fitted part"))
    holes = runs(missing)
    if len(holes):
        longest = holes[np.argsort(holes[:, 0] - holes[:, 1], kind="stable")[:_SHOWN_HOLES]]
        step_s = time_s[1] - time_s[0]
        edges_s = np.stack([time_s[longest[:, 0]], time_s[longest[:, 1] - 1] + step_s], axis=1)
        bottom = np.full(edges_s.size, y.low)
        found.append(marks.segments(edges_s.ravel(), bottom, marks.HOLE, "holes"))
    return found


def input_plot(
    time_s: FloatArray, values: FloatArray, name: str, *, points: int = CURVE_POINTS
) -> str:
    """Plot an input, (samples,), over time; a long record is drawn by its extremes."""
    curve = _curve(time_s, values, marks.SOLID, "", points)
    panel = Panel(Axis.around(axis_label(name), [values]), [curve], _LOW)
    return chart(View(f"{label_and_unit(name)[0]} over time", _time(time_s), [panel]))


def step_plot(
    time_s: FloatArray, volts: FloatArray, reference_v: FloatArray, command_v: FloatArray
) -> str:
    """Plot position, strain gauges, speed and command of a controlled motion of the arm.

    Parameters
    ----------
    time_s : ndarray, (samples,)
        Time.
    volts : ndarray, (samples, 4)
        Position, base strain, middle strain and speed.
    reference_v, command_v : ndarray, (samples,)
        Set-point of the position, and command of the drive.
    """
    angle_v, base_v, middle_v, rate_v = volts.T
    angle, _, _, rate = CHANNEL_NAMES
    rows: Sequence[tuple[str, str, dict[str, FloatArray]]] = (
        ("position, V", angle, {"position": angle_v, "set-point": reference_v}),
        ("strain, V", "", {"base strain": base_v, "middle strain": middle_v}),
        ("speed, V", rate, {"speed": rate_v}),
        ("command, V", "", {"command": command_v}),
    )
    panels = []
    for label, channel, curves in rows:
        y = Axis.around(label, curves.values(), ticks=4, second=ARM_UNITS.get(channel))
        looks = zip(curves.items(), (marks.SOLID, marks.DASHED), strict=False)
        lines = [_curve(time_s, values, look, name, CURVE_POINTS) for (name, values), look in looks]
        panels.append(Panel(y, lines, _LOW))
    words = "controlled motion: position, strain, speed and command over time"
    return chart(View(words, _time(time_s), panels))


def _curve(time_s: FloatArray, values: FloatArray, look: str, label: str, points: int) -> Mark:
    rows = extremes(values, points)
    return marks.line(time_s[rows], values[rows], look, label)


def _time(time_s: FloatArray) -> Axis:
    # To the end of the last period, so that the axis ends in a round number.
    end_s = time_s[0] + (time_s[-1] - time_s[0]) * len(time_s) / max(len(time_s) - 1, 1)
    return Axis("time, s", float(time_s[0]), float(end_s), ticks=8)


def extremes(values: FloatArray, points: int) -> NDArray[np.intp]:
    """Return the rows of the extremes of equal parts, so that no peak is lost."""
    if len(values) <= points:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), points // 2 + 1).astype(np.intp)
    longest = int(np.diff(edges).max())
    # Shorter parts are filled up with their last row.
    rows = np.minimum(edges[:-1, None] + np.arange(longest), edges[1:, None] - 1)
    inside = values[rows]
    missing = np.isnan(inside)
    lowest = np.where(missing, np.inf, inside).argmin(axis=1)
    highest = np.where(missing, -np.inf, inside).argmax(axis=1)
    # One row of each hole breaks the curve off.
    broken = np.flatnonzero(missing.any(axis=1))
    part = np.arange(len(rows))
    found = rows[part, lowest], rows[part, highest], rows[broken, missing.argmax(axis=1)[broken]]
    return np.unique(np.concatenate(found))
