"""Signals of different rates on one even grid, and offsets of those with instants of receiving.

The mean delay of each topic stays in its even instants. Where outputs are the more delayed ones,
commands seem to come before the samples that they answer, and the row before holds a part of the
next command: the input knows the future, which looks like a closed loop. How late a topic is in the
mean is not known, but the scatter of its delays bounds it, and outputs with little noise tell
whether a command acts before its row.

The grid is that of the densest output. An input that is held acts with its mean over each period,
one that was measured with the mean of the lines between its samples. Outputs that were sampled at
other instants are read off a cubic spline through their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_core.clock import NS
from flexarm_core.errors import DataError
from flexarm_ident.reading.grid import ON_TIME, held, on_grid, place
from flexarm_ident.reading.tracks import counted_periods
from flexarm_ident.records.holes import LONGEST_FILLED
from flexarm_ident.subspace.feedback import SMALLEST_REMAINDER
from flexarm_ident.subspace.innovations import MEMORY, centred, longest, remainder, shifted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.reading.grid import Grid
    from flexarm_ident.reading.tracks import Evened, Track

    Integers = NDArray[np.int64]

# The least delay, which no scatter shows, may be as long as the mean above it.
_REACH = 2.0
# Part of a sender's messages that keep their distance from the rows.
_MOST = 0.9
# Rows for each coefficient of a prediction.
_ROWS_PER_COEFFICIENT = 4
# What makes a record e^10 times less likely is refuted.
_CLEAR = 10.0
# A gap of more steps of a signal's own is not bridged.
_LONGEST_GAP = LONGEST_FILLED + 1.5
# Nodes of a spline that are closer, in steps of the signal, would make it swing.
_CLOSEST = 0.25


@dataclass(frozen=True)
class Offset:
    """Time by which commands were moved to the rows behind them."""

    label: str
    early_s: float


def on_their_rows(
    inputs: Sequence[Evened], outputs: Sequence[Evened], *, interpolated: bool = False
) -> tuple[CommonRows, list[Offset]]:
    """Put signals on rows as `common_rows` does, and commands that come too early on their own.

    Commands are moved to the rows behind them when these are as near as the scatter of the delays
    allows, and the outputs refute that they act before. A controller's command names the sample
    that it answers, so what would be moved in error in a loop stays as it was received.

    Parameters
    ----------
    inputs, outputs : sequence of Evened
        Signals at the even instants behind their arrivals.
    interpolated : bool
        Inputs were measured, as in `common_rows`; none is moved.

    Returns
    -------
    CommonRows, list of Offset
        Rows, and what was moved.

    Raises
    ------
    DataError
        As in `common_rows`.
    """
    commands, sampled = ([each.sent for each in signals] for signals in (inputs, outputs))
    found, offsets = common_rows(commands, sampled, interpolated=interpolated), []
    late_s = max(each.early_s for each in outputs)
    for together in [] if interpolated else _of_one_sender(commands):
        first = together[0]
        ahead = _ahead(found.acting[first])
        early_s = ahead * found.grid.period_s
        if ahead <= ON_TIME or early_s > _REACH * (late_s + inputs[first].early_s):
            continue
        tried = [
            _later(each, early_s) if number in together else each
            for number, each in enumerate(commands)
        ]
        moved = common_rows(tried, sampled)
        if _is_refuted(ahead, moved, together):
            found, commands = moved, tried
            offsets.append(Offset(commands[first].label, early_s))
    return found, offsets


def _of_one_sender(commands: Sequence[Track]) -> list[list[int]]:
    """Return the numbers of the inputs whose values come in the same messages."""
    senders: dict[bytes, list[int]] = {}
    for number, each in enumerate(commands):
        senders.setdefault(each.times_ns.tobytes(), []).append(number)
    return list(senders.values())


def _ahead(instants: FloatArray) -> float:
    """Return how far commands are before their nearest rows, in periods.

    It is 0 where they are behind them, or keep no distance from the rows, as events do.
    """
    phases = np.exp(2j * np.pi * instants)
    usual = np.angle(phases.mean()) / (2.0 * np.pi)
    off = np.angle(phases * np.exp(-2j * np.pi * usual)) / (2.0 * np.pi)
    keeps = np.mean(np.abs(off) <= ON_TIME) >= _MOST
    return max(0.0, -float(usual)) if keeps else 0.0


def _later(command: Track, by_s: float) -> Track:
    return replace(command, times_ns=command.times_ns + round(by_s * NS))


def _is_refuted(ahead: float, moved: CommonRows, together: Sequence[int]) -> bool:
    """Return whether the outputs refute commands that act so many periods before their rows.

    Such commands would have a part in the row before. It is least in an output that integrates
    twice, which goes by the square of the time.
    """
    u, part = moved.u[:-1], ahead**2
    early = u.copy()
    early[:, together] += part * (moved.u[1:, together] - u[:, together])
    likelihoods = [_log_likelihood(each, moved.y[:-1]) for each in (u, early)]
    return likelihoods[0] - likelihoods[1] > _CLEAR


def _log_likelihood(u: FloatArray, y: FloatArray) -> float:
    """Return that of predicting each row from those before it; 0 for a record that is too short."""
    part = longest(y)
    channels = u.shape[1] + y.shape[1]
    if part.stop - part.start < MEMORY * (1 + _ROWS_PER_COEFFICIENT * channels):
        return 0.0
    u, y = centred(u[part]), centred(y[part])
    errors = remainder(np.hstack([shifted(y, 1), shifted(u, 1)]), y[MEMORY:])
    # Errors of less are rounding.
    floor = SMALLEST_REMAINDER**2 * np.eye(y.shape[1])
    covariance = errors.T @ errors / len(errors) + floor
    return -0.5 * len(errors) * float(np.linalg.slogdet(covariance)[1])


@dataclass(frozen=True, eq=False)
class CommonRows:
    """Signals on one grid.

    Attributes
    ----------
    u : ndarray, (rows, inputs)
        Means over the period that begins with each row.
    y : ndarray, (rows, outputs)
        Values at the rows' instants; NaN where a signal has a gap.
    grid : Grid
        Places of the samples of the leading output.
    lead : Track
        The densest output.
    rows : ndarray of int, (rows,)
        Places of the rows on the grid: those in which every signal is there.
    acting : tuple of ndarray, (messages,)
        Instants of each input's messages, in periods of the grid.
    """

    u: FloatArray
    y: FloatArray
    grid: Grid
    lead: Track
    rows: Integers
    acting: tuple[FloatArray, ...]

    def in_gap(self, number: int) -> NDArray[np.bool_]:
        """Return the rows in which messages of one input should have come and did not.

        Parameters
        ----------
        number : int
            Number of the input, from 0; it is sent evenly.

        Returns
        -------
        ndarray of bool, (rows,)
            True from one step behind the last message before a gap to the first one after it.
        """
        instants = self.acting[number]
        steps = np.diff(instants)
        usual = float(np.median(steps))
        gaps = np.flatnonzero(steps > _LONGEST_GAP * usual)
        # Its last message before a gap was in force for a step.
        begins, ends = instants[gaps] + usual, instants[gaps + 1]
        gap = np.searchsorted(begins, self.rows, side="right") - 1
        return np.asarray((gap >= 0) & (self.rows < np.append(ends, -np.inf)[gap]))


def common_rows(
    inputs: Sequence[Track], outputs: Sequence[Track], *, interpolated: bool = False
) -> CommonRows:
    """Put inputs and outputs on the grid of the densest output.

    Parameters
    ----------
    inputs, outputs : sequence of Track
        Signals by one clock; one output or more.
    interpolated : bool
        Inputs run on lines between their messages, as measured ones do. Else each message is in
        force until the next, as a command is.

    Raises
    ------
    DataError
        If they are not all there for two periods, or the instants do not advance.
    """
    lead = min(outputs, key=lambda signal: signal.period_s)
    try:
        grid = place(counted_periods(lead.times_ns), lead.times_ns)
    except DataError as error:
        raise DataError(f"{lead.label}: {error}") from None
    kept_ns = lead.times_ns[grid.kept]
    acting = [_instants(signal, kept_ns, grid) for signal in inputs]
    sampled = [_instants(signal, kept_ns, grid) for signal in outputs]
    begins = max(float(at[0]) for at in (*acting, *sampled))
    # A command stays in force behind its message; what was measured ends with the last one.
    ends = min(float(at[-1]) for at in sampled)
    if interpolated:
        ends = min(ends, *(float(at[-1]) - 1.0 for at in acting))
    rows = np.arange(int(np.ceil(begins)), int(np.floor(ends)) + 1)
    if len(rows) < 2 or any(at[-1] < begins for at in acting):  # noqa: PLR2004 - a record has a step
        raise DataError(
            f"the topics do not overlap: {_extents((*inputs, *outputs))}; stamps of different "
            "machines or of a simulation may need the other clock (--clock)"
        )
    driven = _mean_of_lines if interpolated else _mean_of_steps
    u = np.empty((len(rows), len(inputs)))
    for number, (at, signal) in enumerate(zip(acting, inputs, strict=True)):
        u[:, number] = driven(at, signal.values, rows)
    y = [
        on_grid(grid.instants, signal.values[grid.kept, np.newaxis], rows)[:, 0]
        if np.array_equal(signal.times_ns, lead.times_ns)
        else _splined(at, signal.values, rows)
        for at, signal in zip(sampled, outputs, strict=True)
    ]
    return CommonRows(u, np.stack(y, axis=1), grid, lead, rows, tuple(acting))


def _instants(signal: Track, kept_ns: Integers, grid: Grid) -> FloatArray:
    """Return the instants of a signal in periods of the grid, rising.

    Those that it shares with the leading output are the same as there.
    """
    start_ns = kept_ns[0]
    known_s, times_s = (kept_ns - start_ns) / NS, (signal.times_ns - start_ns) / NS
    inside = np.interp(times_s, known_s, grid.instants)
    before = times_s.clip(max=0.0)
    behind = (times_s - known_s[-1]).clip(min=0.0)
    return np.asarray(inside + (before + behind) / grid.period_s)


def _mean_of_steps(instants: FloatArray, values: FloatArray, rows: Integers) -> FloatArray:
    punctual = np.where(_is_punctual(instants), np.rint(instants), instants)
    return held(punctual, values[:, np.newaxis], rows)[:, 0]


def _is_punctual(instants: FloatArray) -> BoolArray:
    """Mark the messages that are near enough to a row to act from it on.

    Those that keep a distance which wanders about the limit are all near, or none: else the input
    would act in two ways in one record.
    """
    off = instants - np.rint(instants)
    around = off[np.abs(off) <= 2.0 * ON_TIME]
    if not len(around):
        return np.zeros(len(off), dtype=np.bool_)
    usual = float(np.median(around))
    own = np.abs(off) <= ON_TIME
    return np.asarray(np.where(np.abs(off - usual) <= ON_TIME, abs(usual) <= ON_TIME, own))


def _mean_of_lines(instants: FloatArray, values: FloatArray, rows: Integers) -> FloatArray:
    area = scipy.interpolate.make_interp_spline(instants, values, k=1).antiderivative()
    return np.asarray(area(rows + 1.0) - area(rows.astype(np.float64)))


def _splined(instants: FloatArray, values: FloatArray, rows: Integers) -> FloatArray:
    usual = float(np.median(np.diff(instants)))
    apart = np.concatenate([[True], np.diff(instants) > _CLOSEST * usual])
    instants, values = instants[apart], values[apart]
    found = np.asarray(scipy.interpolate.CubicSpline(instants, values)(rows), dtype=np.float64)
    behind = np.searchsorted(instants, rows).clip(1, len(instants) - 1)
    gaps = instants[behind] - instants[behind - 1]
    off = np.minimum(np.abs(rows - instants[behind - 1]), np.abs(instants[behind] - rows))
    found[(gaps > _LONGEST_GAP * usual) & (off > ON_TIME)] = np.nan
    return found


def _extents(signals: Sequence[Track]) -> str:
    start_ns = min(int(signal.times_ns[0]) for signal in signals)
    return ", ".join(
        f"{signal.label} from {(signal.times_ns[0] - start_ns) / NS:.3f} s"
        f" to {(signal.times_ns[-1] - start_ns) / NS:.3f} s"
        for signal in signals
    )
