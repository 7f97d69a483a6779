"""Instants of samples on an even grid, from stamps and numbers, and findings about them.

The model is one of even samples. A rig that stalls, a recorder that loses messages and a clock that
jitters give uneven ones. Here each sample gets its instant in periods, and each instant of the grid
the samples around it, so that holes are holes in time for any numbers.

The phase of a steady clock's stamps is tracked slowly, as it drifts against the nominal period.
Where stamps jitter too much for a reliable phase, numbers that count periods place the samples, and
the stamps give the distance of each from its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.clock import NS, nominal_rate_hz
from flexarm_core.errors import DataError
from flexarm_core.labels import counted, instant
from flexarm_ident.records.data_warning import LOST_SAMPLES, PARTIAL_RECORD, SAMPLING, Grade
from flexarm_ident.records.holes import holes_text, lagrange
from flexarm_ident.records.signals import NORMAL_MAD

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning

    Integers = NDArray[np.int64]

ON_TIME = 0.1
"""A sample so near to its instant, in periods, is taken as it is."""
LATEST = 0.3
"""A sample further off than this counts only when its neighbours tell what it was in time."""
EARLY = 0.3
"""A sample earlier than this, in periods, is a late one of the period before."""
STEADY = 0.15
"""Scatter of the steps, in periods, beyond which they tell neither a phase nor what was lost."""
_PHASE_BLOCK = 128
# What jitters needs more stamps for a phase.
_JITTER_BLOCK = 1024
# A longer step is a clock that was set, when the numbers go on.
_LONGEST_HOLE_S = 60.0
# Neighbours closer than this to a sample tell nothing of its slope, and further off neither.
_NEAREST, _FURTHEST = 0.5, 2.5
MOST_ROWS = 100
"""Rows for each sample: more come from pauses or bursts, and would fill the memory."""
# Instants that scatter by this part of the period, RMS, matter to a model of even ones.
JITTER_TOLERANCE = 0.1
CUT = 0.05
"""Part of a record that may be left out without harm."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Samples on an even grid.

    Attributes
    ----------
    period_s : float
        Period of the grid: of a whole number of hertz where the stamps do not tell another.
    kept : ndarray of bool, (samples,)
        Samples that are later than all before them; the others are left out.
    instants : ndarray, (kept samples,)
        Rising instants, in periods from row 0; whole numbers for punctual samples.
    samples : int
        Recorded samples, kept or not.
    pauses_s : tuple of float
        Pauses that would take more rows than `MOST_ROWS` times the samples; on the grid each is as
        long as all samples together.
    """

    period_s: float
    kept: NDArray[np.bool_]
    instants: FloatArray
    samples: int
    pauses_s: tuple[float, ...] = ()

    @property
    def rows(self) -> int:
        """Rows from the first to the last sample."""
        return round(float(self.instants[-1])) + 1

    @property
    def lost(self) -> int:
        """Periods without a sample: a late sample belongs to the period in which it was due."""
        first, last = np.floor(self.instants[[0, -1]] + EARLY)
        return max(0, int(last - first) + 1 - self.samples)

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Rows without a nearest sample, (rows,)."""
        missing = np.ones(self.rows, dtype=np.bool_)
        missing[np.rint(self.instants).astype(np.int64)] = False
        return missing


def place(sequence: Integers, stamps_ns: Integers) -> Grid:
    """Find the grid of samples; one without jitter and holes has the row numbers as instants.

    Parameters
    ----------
    sequence : ndarray of int, (samples,)
        Numbers, rising.
    stamps_ns : ndarray of int, (samples,)
        Instants.

    Raises
    ------
    DataError
        If there are fewer than two samples, the stamps do not advance, or the samples come in
        bursts that would take more than `MOST_ROWS` rows for each.
    """
    times_s = (stamps_ns - stamps_ns[0]) / NS
    if len(times_s) < 2:  # noqa: PLR2004 - a period needs two samples
        raise DataError("no two samples follow each other; record again")
    numbers = (sequence - sequence[0]).astype(np.float64)
    kept = _rising(times_s)
    usual_s = float(np.median(np.diff(times_s) / np.diff(numbers)))
    if usual_s <= 0 or 2 * np.count_nonzero(kept) < len(kept):
        raise DataError("the stamps do not advance; set the clock of the recording machine right")
    times_s, numbers = times_s[kept], numbers[kept]
    times_s = _without_jumps(times_s, numbers, usual_s)
    times_s, numbers, pauses_s = _without_pauses(times_s, numbers, usual_s)
    if _scatter(times_s, numbers, usual_s) <= STEADY:
        period_s, instants = _by_steps(times_s, usual_s)
    else:
        period_s, instants = _by_numbers(times_s, numbers)
    instants = np.where(_is_near(instants), np.rint(instants), instants)
    instants -= np.rint(instants[0])
    rising = _rising(instants)
    kept[np.flatnonzero(kept)[~rising]] = False
    rows = float(instants[rising][-1]) + 1.0
    if not rows <= MOST_ROWS * len(sequence):
        raise DataError(
            f"{len(sequence)} samples in {rows * period_s:.6g} s, but steps of "
            f"{1e3 * period_s:.6g} ms: they come in bursts, or with many long pauses; take the "
            "other clock, or cut the record"
        )
    return Grid(period_s, kept, instants[rising], len(sequence), pauses_s)


def _rising(values: FloatArray) -> NDArray[np.bool_]:
    """Mark the values that are above all before them."""
    return np.asarray(values > np.concatenate([[-np.inf], np.maximum.accumulate(values)[:-1]]))


def _is_near(instants: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(np.abs(instants - np.rint(instants)) <= ON_TIME)


def _nominal(period_s: float, places: FloatArray) -> float:
    """Return a period, or that of a whole number of hertz, given the samples' places."""
    return 1.0 / nominal_rate_hz(1.0 / period_s, float(places[-1] - places[0]))


def _without_jumps(times_s: FloatArray, numbers: FloatArray, usual_s: float) -> FloatArray:
    """Remove steps of a clock that was set forward while the numbers went on."""
    excess_s = np.diff(times_s) - np.diff(numbers) * usual_s
    jumps_s = np.where(excess_s > _LONGEST_HOLE_S, excess_s, 0.0)
    if not jumps_s.any():
        return times_s
    return np.asarray(times_s - np.concatenate([[0.0], np.cumsum(jumps_s)]))


def _without_pauses(
    times_s: FloatArray, numbers: FloatArray, usual_s: float
) -> tuple[FloatArray, FloatArray, tuple[float, ...]]:
    """Shorten pauses of stamps and numbers that are far longer than all that was measured."""
    steps_s, steps = np.diff(times_s), np.diff(numbers)
    long = np.minimum(steps_s / usual_s, steps) > MOST_ROWS * len(times_s)
    if not long.any():
        return times_s, numbers, ()
    # Apart from each other: so many periods have lost the phase.
    pauses_s = tuple(steps_s[long].tolist())
    steps_s[long], steps[long] = len(times_s) * usual_s, len(times_s)
    return _summed(steps_s), _summed(steps), pauses_s


def _summed(steps: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _scatter(times_s: FloatArray, numbers: FloatArray, usual_s: float) -> float:
    """Return the scatter of steps from one number to the next, in periods."""
    following = np.diff(times_s)[np.diff(numbers) == 1] / usual_s - 1.0
    return NORMAL_MAD * float(np.median(np.abs(following))) if len(following) else 0.0


def _by_steps(times_s: FloatArray, usual_s: float) -> tuple[float, FloatArray]:
    """Return the period and the instants of samples at steps of nearly whole periods.

    Losses bias the median of the steps; the line through the rounded ones is free of that, unless a
    long hole was rounded wrong. The phase gives its length.
    """
    rounded = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(times_s) / usual_s))])
    for _ in range(2):
        period_s = _nominal(_slope(rounded, times_s), rounded)
        instants = _by_phase(times_s / period_s)
        rounded = np.rint(instants)
    return period_s, instants


def _slope(x: FloatArray, y: FloatArray) -> float:
    """Return the slope of the line through points; it takes a third of `polyfit`'s memory."""
    x = x - x.mean()
    return float(x @ y / (x @ x))


def _by_phase(instants: FloatArray) -> FloatArray:
    """Subtract the phase of the stamps, which drifts slowly.

    The phase is the direction of the mean of the stamps as points of a circle, over blocks, with a
    line between their middles. Occasional late stamps do not move it.
    """
    starts = np.arange(0, len(instants), _PHASE_BLOCK)
    sums = np.array(
        [
            np.exp(2j * np.pi * (instants[first : first + _PHASE_BLOCK] - instants[0])).sum()
            for first in starts
        ]
    )
    counts = np.diff(np.append(starts, len(instants)))
    middles = np.add.reduceat(instants, starts) / counts
    phases = np.unwrap(np.angle(sums)) / (2.0 * np.pi)
    return np.asarray(instants - instants[0] - np.interp(instants, middles, phases))


def _by_numbers(times_s: FloatArray, numbers: FloatArray) -> tuple[float, FloatArray]:
    """Return the period and the instants of samples whose numbers count periods."""
    slope, offset = np.polyfit(numbers, times_s, 1)
    period_s = _nominal(float(slope), numbers)
    late = (times_s - offset) / period_s - numbers
    blocks = -(-len(late) // _JITTER_BLOCK)
    parts = np.array_split(np.arange(len(late)), blocks)
    middles = np.array([numbers[part].mean() for part in parts])
    phases = np.array([np.median(late[part]) for part in parts])
    return period_s, np.asarray(numbers + late - np.interp(numbers, middles, phases))


def on_grid(instants: FloatArray, values: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
    """Return samples at the grid's own instants.

    A sample that is off its instant is referred to it by the parabola through it and its
    neighbours, at their own instants.

    Parameters
    ----------
    instants : ndarray, (samples,)
        Instants of the samples, in periods, rising.
    values : ndarray, (samples, channels)
        The samples; NaN for a channel that was not measured.
    rows : ndarray, (rows,)
        Wanted instants.

    Returns
    -------
    ndarray, (rows, channels)
        Values; NaN without a sample within half a period, or with one too far off its instant and
        no neighbours.
    """
    nearest = _nearest(instants, rows)
    off = rows - instants[nearest]
    found = values[nearest].copy()
    found[np.abs(off) > 0.5] = np.nan  # noqa: PLR2004 - another row's sample
    wanted = np.flatnonzero((off != 0.0) & (np.abs(off) <= 0.5))  # noqa: PLR2004
    if len(wanted):
        found[wanted] = _referred(instants, values, nearest[wanted], rows[wanted], off[wanted])
    return found


def _nearest(instants: FloatArray, rows: NDArray[np.int64]) -> NDArray[np.intp]:
    after = np.searchsorted(instants, rows).clip(1, max(len(instants) - 1, 1))
    if len(instants) == 1:
        return np.zeros(len(rows), dtype=np.intp)
    before = after - 1
    nearer = rows - instants[before] <= instants[after] - rows
    return np.asarray(np.where(nearer, before, after))


def _referred(
    instants: FloatArray,
    values: FloatArray,
    at: NDArray[np.intp],
    rows: NDArray[np.int64],
    off: FloatArray,
) -> FloatArray:
    last = len(instants) - 1

    def neighbour(side: int) -> NDArray[np.intp]:
        first = (at + side).clip(0, last)
        close = np.abs(instants[first] - instants[at]) < _NEAREST
        return np.where(close, (at + 2 * side).clip(0, last), first)

    nodes = np.stack([neighbour(-1), at, neighbour(1)], axis=1)
    reach = np.abs(np.diff(instants[nodes], axis=1))
    good = np.all((reach >= _NEAREST) & (reach <= _FURTHEST), axis=1)
    found = values[at].copy()
    found[good] = lagrange(
        instants[nodes[good]], values[nodes[good]], rows[good].astype(np.float64)
    )
    # A channel that a neighbour lacks is left as it was taken.
    known = np.isnan(found) & ~np.isnan(values[at])
    found = np.where(known, values[at], found)
    alone = ~good[:, np.newaxis] | known
    too_late = (np.abs(off) > LATEST)[:, np.newaxis]
    return np.asarray(np.where(alone & too_late, np.nan, found), dtype=np.float64)


def held(instants: FloatArray, values: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
    """Return the mean over each period of an input that is held from one instant to the next.

    Parameters
    ----------
    instants : ndarray, (changes,)
        Instants of the changes, in periods, rising.
    values : ndarray, (changes, inputs)
        Values from then on.
    rows : ndarray, (rows,)
        Wanted periods, each by its start.

    Returns
    -------
    ndarray, (rows, inputs)
        Means; the first value before the first change, the last value behind the last one.
    """
    latest = (np.searchsorted(instants, rows, side="right") - 1).clip(min=0)
    behind = np.searchsorted(instants, rows + 1, side="left")
    found: FloatArray = values[latest]
    mixed = np.flatnonzero(behind > latest + 1)
    if not len(mixed):
        return found
    # Each value that acts in such a period has a part of it.
    counts = (behind - latest)[mixed]
    firsts = np.cumsum(counts) - counts
    acting = np.arange(counts.sum()) + np.repeat(latest[mixed] - firsts, counts)
    starts = instants[acting]
    starts[firsts] = rows[mixed]
    ends = np.append(starts[1:], 0.0)
    ends[firsts + counts - 1] = rows[mixed] + 1
    found[mixed] = np.add.reduceat((ends - starts)[:, np.newaxis] * values[acting], firsts)
    return found


@dataclass(frozen=True)
class Run:
    """The longest run of samples with rising numbers.

    Attributes
    ----------
    messages : slice
        Its messages.
    restarts : int
        Restarts of the numbering on the topic.
    """

    messages: slice
    restarts: int


def longest_run(sequence: NDArray[np.int64]) -> Run:
    """Return the longest run in which the numbers, (samples,), go up; of equal ones the first."""
    cuts = np.flatnonzero(np.diff(sequence) < 1) + 1
    edges = np.concatenate(([0], cuts, [len(sequence)]))
    longest = int(np.argmax(np.diff(edges)))
    return Run(slice(int(edges[longest]), int(edges[longest + 1])), len(cuts))


def notices(run: Run, grid: Grid, messages: int) -> tuple[DataWarning, ...]:
    """Return what is reported of restarts, holes and late samples, each where it applies.

    Parameters
    ----------
    run : Run
        The run that is used.
    grid : Grid
        Its samples on the grid.
    messages : int
        Messages on the topic.
    """
    return (*_restarted(run, messages), *_lost_samples(grid), *_clock_jitter(grid))


def _restarted(run: Run, messages: int) -> tuple[DataWarning, ...]:
    if not run.restarts:
        return ()
    first, last = run.messages.start, run.messages.stop - 1
    text = (
        f"the numbering starts again at {counted(run.restarts, 'place')}: used messages {first} "
        f"to {last} of {messages}, the longest run"
    )
    figures = {
        "places": float(run.restarts),
        "first": float(first),
        "last": float(last),
        "messages": float(messages),
    }
    return (PARTIAL_RECORD(text, figures),)


def _lost_samples(grid: Grid) -> tuple[DataWarning, ...]:
    if not grid.missing.any():
        return ()
    text, figures = holes_text(grid.missing, grid.period_s, lost=grid.lost)
    for pause_s in grid.pauses_s:
        text += (
            f"; a pause of {pause_s:.6g} s counts as one of {grid.samples * grid.period_s:.6g} s"
        )
    harmless = figures["left_out"] <= CUT * grid.rows
    grade = Grade.INFORMATION if harmless else Grade.CAUTION
    return (LOST_SAMPLES(text, figures, grade=grade),)


def _clock_jitter(grid: Grid) -> tuple[DataWarning, ...]:
    off = grid.instants - np.rint(grid.instants)
    late = np.abs(off) > LATEST
    deviation = float(np.sqrt(np.mean(off**2)))
    if not late.any() and deviation <= JITTER_TOLERANCE:
        return ()
    worst = int(np.argmax(np.abs(off)))
    row = int(np.rint(grid.instants[worst]))
    period_ms = 1e3 * grid.period_s
    text = (
        f"{int(late.sum())} of {len(off)} samples were taken more than {LATEST:g} periods off "
        f"their instants, the worst by {period_ms * off[worst]:+.3f} ms at "
        f"{instant(row, grid.period_s)} (all {period_ms * deviation:.3f} ms RMS, the period is "
        f"{period_ms:.3f} ms): they were referred to their instants by their neighbours"
    )
    figures = {
        "late": float(late.sum()),
        "samples": float(len(off)),
        "worst_s": grid.period_s * float(off[worst]),
        "row": float(row),
        "period_s": grid.period_s,
        "deviation_s": grid.period_s * deviation,
    }
    return (SAMPLING(text, figures),)
