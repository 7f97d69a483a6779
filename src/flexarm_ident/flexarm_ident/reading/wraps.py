"""Angles that wrap: an encoder that goes on at 0 behind 360 has turned on, and not back.

An output wraps when it jumps by one whole period of an encoder and moves slowly else: steps are
below a quarter of its range or above three quarters, and a jump less the steps around it is the
period, within 1 % or as far as those steps differ, and leaves a step as there are others. It jumps
in both directions, or at uneven intervals: a sawtooth that is sent evenly in one direction stays
as it is, and so does one that an input's jumps explain.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.labels import counted
from flexarm_ident.records.data_warning import CONVERTED, Grade
from flexarm_ident.records.signals import FEW_LEVELS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning

    Rows = tuple[FloatArray, FloatArray]

# A turn as one, in degrees, tenths and hundredths of them, radians, gon, half a turn as of a
# line or an arctangent, counts of encoders of so many lines, and those of 8 to 32 bits.
_LINES = (250, 500, 1000, 1250, 2000, 2500, 5000, 10000)
PERIODS = (
    *(1.0, 360.0, 3600.0, 36000.0, 2.0 * math.pi, 400.0, 180.0, math.pi),
    *(4.0 * lines for lines in _LINES),
    *(2.0**bits for bits in range(8, 33)),
)
_TOLERANCE = 0.01
_SMALL, _LARGE = 0.25, 0.75
# Part of a period by which printed values may be beyond it, and how much faster than elsewhere an
# angle may cross it.
_BEYOND, _LONGER = 5e-4, 1.2
# Part of the steps that lost samples may have made ambiguous.
_AMBIGUOUS = 0.01
# Part of the power of an angle's accelerations that is left when its turns are counted, and of the
# period that it fills.
_SMOOTHER, _FILLED = 0.1, 0.98
# Fewer jumps have no even intervals, which differ by less than this part or two samples.
_FEWEST_EVEN, _EVEN, _EVEN_SAMPLES = 3, 0.05, 2.0
_EXPLAINED, _ANSWER = 0.8, 3


class Wrap(NamedTuple):
    """Period of an output, 0 without one, the number of its jumps, and a period in doubt."""

    period: float
    jumps: int = 0
    doubt: float = 0.0


def found_wraps(pieces: Iterable[Rows], turn: float | None = None) -> list[Wrap]:
    """Return the wraps of the outputs of a record.

    Parameters
    ----------
    pieces : iterable of (u, y)
        Samples in the order of sending, in pieces of any length; NaN is not measured.
    turn : float, optional
        Period of every output that jumps by more than half of it; 0 where none wraps. None: found.
    """
    found: list[Wrap] = []
    for u, y in pieces:
        with np.errstate(over="ignore"):
            here = [_wrap(u, values, turn) for values in y.T]
        found = [
            Wrap(max(a.period, b.period), a.jumps + b.jumps, max(a.doubt, b.doubt))
            for a, b in zip(found or [Wrap(0.0)] * len(here), here, strict=True)
        ]
    return found


def unwrapped(pieces: Iterable[Rows], wraps: Sequence[Wrap]) -> Iterator[Rows]:
    """Yield samples with the turns of their outputs counted, pieces as in `found_wraps`."""
    turning = [channel for channel, wrap in enumerate(wraps) if wrap.period]
    last = dict.fromkeys(turning, math.nan)
    for u, y in pieces:
        if turning:
            y = y.copy()  # noqa: PLW2901 - pieces are read only
        for channel in turning:
            known = ~np.isnan(y[:, channel])
            if known.any():
                before = [] if math.isnan(last[channel]) else [last[channel]]
                values = np.concatenate([before, y[known, channel]])
                turned = np.unwrap(values, period=wraps[channel].period)
                y[known, channel] = turned[len(before) :]
                last[channel] = float(turned[-1])
        yield u, y


def wrap_notices(names: Sequence[str], wraps: Sequence[Wrap]) -> Iterator[DataWarning]:
    """Yield a word on each output whose turns are counted."""
    # Names that do not fit the channels are refused elsewhere.
    for name, wrap in zip(names, wraps, strict=False):
        if wrap.period:
            yield CONVERTED(
                f"{name} wraps at {wrap.period:.6g}, {counted(wrap.jumps, 'time')}: its turns are "
                "counted; if its jumps are real, say --wrap 0",
                {"period": wrap.period, "jumps": float(wrap.jumps)},
                channel=name,
            )
        elif wrap.doubt:
            yield CONVERTED(
                f"{name} fills {wrap.doubt:.6g} and steps by more than a quarter of it: an angle "
                "that wraps there is too fast for its turns to be counted; sample faster, or say "
                f"--wrap {wrap.doubt:.6g} if it never turns by half of that in a sample",
                {"period": wrap.doubt},
                grade=Grade.CAUTION,
                channel=name,
            )


def _wrap(u: FloatArray, y: FloatArray, turn: float | None) -> Wrap:
    known = np.flatnonzero(~np.isnan(y))
    steps = np.diff(y[known])
    if not len(steps) or turn == 0.0:
        return Wrap(0.0)
    size = np.abs(steps)
    if turn is not None:
        jumps = int(np.count_nonzero(size > 0.5 * turn))
        return Wrap(turn if jumps else 0.0, jumps)
    extent = float(np.ptp(y[known]))
    if not 0.5 * min(PERIODS) < extent < 2.0 * max(PERIODS):
        return Wrap(0.0)
    at = np.flatnonzero(size > _LARGE * extent)
    ambiguous = np.count_nonzero((size > _SMALL * extent) & (size <= _LARGE * extent))
    if ambiguous > _AMBIGUOUS * len(steps):
        return Wrap(0.0, doubt=_doubtful(y[known], extent))
    if not len(at) or 2 * len(at) > len(steps):
        return Wrap(0.0)
    period = _period(steps, at, extent)
    is_clear = (
        period > 0.0
        and len(np.unique(y[known])) > FEW_LEVELS
        and not _is_even_sawtooth(steps[at], at)
        and not _is_explained(u, known[at + 1])
    )
    return Wrap(period, len(at)) if is_clear else Wrap(0.0)


def _doubtful(y: FloatArray, extent: float) -> float:
    """Return the period that a fast angle fills and that makes it smoother; else 0."""
    fitting = [each for each in PERIODS if _FILLED * each <= extent <= each * (1.0 + _BEYOND)]
    if not fitting or len(np.unique(y)) <= FEW_LEVELS:
        return 0.0
    raw, turned = (np.var(np.diff(x, 2)) for x in (y, np.unwrap(y, period=fitting[0])))
    return fitting[0] if turned < _SMOOTHER * raw else 0.0


def _period(steps: FloatArray, at: NDArray[np.intp], extent: float) -> float:
    """Return the period of an encoder that jumps have with the motion taken off; else 0."""
    moving = steps.copy()
    moving[at] = np.nan
    padded = np.concatenate([[np.nan], moving, [np.nan]])
    around = np.stack([padded[at], padded[at + 2]])
    counts = np.isfinite(around).sum(axis=0)
    motion = np.where(counts > 0, np.nansum(around, axis=0) / counts.clip(min=1), 0.0)
    jump = float(np.median(np.abs(steps[at] - motion)))
    # The motion at a jump is known as well as the steps on both sides agree.
    both = around[:, np.isfinite(around).all(axis=0)]
    unsure = 0.5 * float(np.median(np.ptp(both, axis=0))) if both.size else 0.0
    near = [
        each
        for each in PERIODS
        if abs(jump - each) <= max(_TOLERANCE * each, unsure)
        and extent <= each * (1.0 + _BEYOND)
        # Without the turn, the jump is a step like others.
        and np.median(np.abs(np.abs(steps[at]) - each))
        <= _LONGER * np.nanmax(np.abs(moving), initial=0.0)
    ]

    def roughness(period: float) -> float:
        turned = steps.copy()
        turned[at] -= period * np.sign(steps[at])
        return float(np.var(np.diff(turned)))

    return min(near, key=roughness, default=0.0)


def _is_even_sawtooth(jumps: FloatArray, at: NDArray[np.intp]) -> bool:
    """Return whether jumps go one way at even intervals, as no motor that is driven turns."""
    if len(at) < _FEWEST_EVEN or abs(np.sign(jumps).sum()) < len(jumps):
        return False
    intervals = np.diff(at)
    return bool(np.ptp(intervals) <= max(_EVEN_SAMPLES, _EVEN * float(np.median(intervals))))


def _is_explained(u: FloatArray, rows: NDArray[np.intp]) -> bool:
    """Return whether an input jumps just before most jumps of an output."""
    steps = np.abs(np.diff(u, axis=0, prepend=u[:1]))
    extent = np.ptp(u, axis=0)
    for step, most in zip(steps.T, extent, strict=True):
        caused = np.flatnonzero(step > 0.5 * most) if most > 0.0 else np.empty(0, dtype=np.intp)
        # A square wave steps by its whole range; what jumps with the angle is rare otherwise.
        behind = rows[:, np.newaxis] - caused[np.newaxis, :]
        near = np.any((behind >= 0) & (behind <= _ANSWER), axis=1)
        usual = len(caused) * (_ANSWER + 1.0) / len(u)
        if len(caused) and near.mean() >= _EXPLAINED and usual < 0.5 * _EXPLAINED:
            return True
    return False
