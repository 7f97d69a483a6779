"""Figures of the live page beside their lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import POSITION_V_PER_RAD

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_core.arrays import FloatArray

HEADS = ("part", "figure", "measured", "line", "holds")
_SAME_S = 1e-4
"""Stamps of one sample differ by less: they come as float32 after the first of their frame."""


@dataclass(frozen=True)
class Row:
    """Figure of a part; `most` or `least` is its line, where it has one."""

    part: str
    figure: str
    value: float
    unit: str = ""
    most: float | None = None
    least: float | None = None

    @property
    def holds(self) -> bool:
        """True when the figure is on the right side of its line; one that is none never is."""
        is_low = self.most is None or self.value <= self.most
        is_high = self.least is None or self.value >= self.least
        return bool(is_low and is_high)

    def cells(self) -> tuple[str, ...]:
        """Return the line of a table."""
        bounds = {"at most": self.most, "at least": self.least}
        lines = [
            f"{words} {self._shown(bound)}" for words, bound in bounds.items() if bound is not None
        ]
        held = ("yes" if self.holds else "no") if lines else ""
        return self.part, self.figure, self._shown(self.value), " and ".join(lines), held

    def _shown(self, value: float) -> str:
        text = f"{value:.0f}" if float(value).is_integer() else f"{value:.3g}"
        return f"{text} {self.unit}".rstrip()


@dataclass(frozen=True)
class Phase:
    """The loop's own figures while somebody looked on, and those of a bare loop beside it."""

    reply_p50_ms: float
    reply_p99_ms: float
    late_p99_ms: float
    missed: int
    unanswered: int
    floor_late_p99_ms: float
    floor_missed: int
    live_cpu: float
    """Share of one core that the live node took."""


def percentile_rows(
    part: str, figure: str, unit: str, values: Sequence[float], lines: Mapping[float, float | None]
) -> list[Row]:
    """Return a row for each percentile, with its line; it is NaN when there are no values."""
    rows = []
    for percent, most in lines.items():
        value = float(np.percentile(values, percent)) if len(values) else np.nan
        name = {50.0: "median", 100.0: "largest"}.get(percent, f"p{percent:g}")
        rows.append(Row(part, f"{figure}, {name} of {len(values)}", value, unit, most=most))
    return rows


def beside_neighbours(values: Sequence[float]) -> list[float]:
    """Return the ratio of each value to the mean of the two beside it, but for both ends."""
    before, here, after = np.array(values[:-2]), np.array(values[1:-1]), np.array(values[2:])
    return list(map(float, 2.0 * here / (before + after)))


def scatter(alone: Sequence[float]) -> float:
    """Return how far a phase with nobody usually is from the two beside it, as a part of them."""
    return float(np.median(np.abs(np.array(beside_neighbours(alone)) - 1.0)))


def loop_rows(
    part: str, alone: Sequence[Phase], onlookers: Mapping[str, Sequence[Phase]], allowance: float
) -> list[Row]:
    """Return the rows of phases with onlookers between phases with nobody.

    Parameters
    ----------
    part : str
        Name of the part.
    alone : sequence of Phase
        Phases with nobody, one more than those with somebody.
    onlookers : mapping of str to sequence of Phase
        Phases with somebody by who it was; all took turns in this order.
    allowance : float
        How much worse the 99th percentile of the reply may be beyond the machine's own scatter.
    """
    own = scatter([phase.reply_p99_ms for phase in alone])
    rows = [
        *_absolute(part, "nobody", alone),
        Row(part, "scatter of reply p99 from one phase with nobody to the next", own),
    ]
    for turn, (who, phases) in enumerate(onlookers.items()):
        rows += _absolute(part, who, phases)
        ratios = []
        for round_, phase in enumerate(phases):
            place = round_ * len(onlookers) + turn
            beside = [each.reply_p99_ms for each in alone[place : place + 2]]
            ratios += beside_neighbours([beside[0], phase.reply_p99_ms, beside[1]])
        ratio = float(np.median(ratios))
        most = 1.0 + allowance + own
        rows.append(Row(part, f"{who}: reply p99 over that with nobody", ratio, most=most))
    return rows


def _absolute(part: str, who: str, phases: Sequence[Phase]) -> list[Row]:
    def median(name: str) -> float:
        return float(np.median([getattr(phase, name) for phase in phases]))

    floor_missed = sum(phase.floor_missed for phase in phases)
    times = {
        "reply p50": "reply_p50_ms",
        "reply p99": "reply_p99_ms",
        "lateness p99": "late_p99_ms",
        "lateness p99 of a bare loop": "floor_late_p99_ms",
    }
    return [
        *(Row(part, f"{who}: {title}", median(name), "ms") for title, name in times.items()),
        Row(
            part,
            f"{who}: missed periods, line: a bare loop's",
            sum(phase.missed for phase in phases),
            most=floor_missed,
        ),
        Row(part, f"{who}: unanswered samples", sum(phase.unanswered for phase in phases)),
        Row(part, f"{who}: CPU of the live node", 100.0 * median("live_cpu"), "% of a core"),
    ]


def drawn_errors_deg(
    drawn: FloatArray, stamps_s: FloatArray, positions_v: FloatArray
) -> FloatArray:
    """Return how far each drawn angle is from that of its sample, in degrees.

    Parameters
    ----------
    drawn : ndarray, (frames, 2)
        Stamp of the newest sample of each frame, and the angle that was drawn, deg.
    stamps_s, positions_v : ndarray, (samples,)
        Samples in order, from another client; frames without their sample here are left out.
    """
    after = np.clip(np.searchsorted(stamps_s, drawn[:, 0]), 1, len(stamps_s) - 1)
    nearest = after - (drawn[:, 0] - stamps_s[after - 1] < stamps_s[after] - drawn[:, 0])
    is_there = np.abs(stamps_s[nearest] - drawn[:, 0]) < _SAME_S
    angles_deg = np.degrees(positions_v[nearest] / POSITION_V_PER_RAD)
    return np.abs(drawn[:, 1] - angles_deg)[is_there]
