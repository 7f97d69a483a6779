"""Holes of a record: rows of the grid at which an output was not measured.

A short hole is filled with the cubic through the two measured samples on either side of it. The
content of a longer one cannot be known from its edges: a straight line bridges it for plots and
filters, and its rows are not used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.arrays import runs
from flexarm_core.labels import counted, instant

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray

    Rows = tuple[FloatArray, FloatArray]

LONGEST_FILLED = 3
"""Samples that may be missing in a row, in one channel, and are filled."""
# The outer samples of a cubic are at most so far from the inner ones.
_REACH = LONGEST_FILLED + 1
CONTEXT = 2 * _REACH + 1
"""Rows on either side of a hole that decide how it is filled."""


def filled(y: FloatArray, missing: BoolArray) -> FloatArray:
    """Fill the missing samples of each channel.

    Parameters
    ----------
    y : ndarray, (samples, channels)
        Values; missing ones may be anything.
    missing : ndarray of bool, (samples, channels)
        Missing samples, not all of a channel.

    Returns
    -------
    ndarray, (samples, channels)
        `y` with cubics in short holes, straight lines in longer ones, and the nearest value before
        the first and behind the last measured sample.
    """
    whole = y.copy()
    for channel in np.flatnonzero(missing.any(axis=0)):
        rows = np.flatnonzero(missing[:, channel])
        known = np.flatnonzero(~missing[:, channel])
        whole[rows, channel] = _between(known, y[known, channel], rows)
    return whole


def unusable_rows(missing: BoolArray) -> BoolArray:
    """Return the rows, (samples,), in which the fill of a channel is not reliable.

    They are those in holes of more than `LONGEST_FILLED` samples of any channel, and before the
    first and behind the last sample of a channel. `missing` has the shape (samples, channels).
    """
    unusable = np.zeros(len(missing), dtype=np.bool_)
    for column in missing[:, missing.any(axis=0)].T:
        for start, stop in runs(column).tolist():
            if stop - start > LONGEST_FILLED or start == 0 or stop == len(column):
                unusable[start:stop] = True
    return unusable


def holes_text(
    missing: BoolArray, period_s: float, *, lost: int | None = None
) -> tuple[str, dict[str, float]]:
    """Return extent, place and fate of the holes of a mask, and the figures.

    Parameters
    ----------
    missing : ndarray of bool, (samples,)
        Rows to fill or to leave out.
    period_s : float
        Period, s.
    lost : int, optional
        Periods without a sample, all rows by default. The other rows are empty because their sample
        came nearer to the instant of the next one.
    """
    holes = runs(missing)
    lengths = np.diff(holes, axis=1)
    unusable = unusable_rows(missing[:, np.newaxis])
    missed, left_out = int(missing.sum()), int(unusable.sum())
    start, stop = holes[np.argmax(lengths)].tolist()
    lost = missed if lost is None else min(lost, missed)
    text = (
        f"{' and '.join(_empty(lost, missed - lost, len(missing)))}, "
        f"in {counted(len(holes), 'hole')}, "
        f"{'the longest ' * (len(holes) > 1)}{_place(start, stop, period_s)}"
    )
    if missed > left_out:
        text += f": those of up to {LONGEST_FILLED} samples were filled"
    if left_out:
        longer = len(runs(unusable))
        text += (
            f"; {counted(longer, 'longer hole')} of {counted(left_out, 'sample')} in all, at most "
            f"{lengths.max()} each, cannot be filled: the parts between are used"
        )
    figures = {
        "lost": float(lost),
        "missing": float(missed),
        "rows": float(len(missing)),
        "holes": float(len(holes)),
        "longest": float(lengths.max()),
        "left_out": float(left_out),
    }
    return text, figures


def _empty(lost: int, late: int, rows: int) -> Iterator[str]:
    """Yield why rows are empty."""
    if lost:
        yield f"{lost} of {counted(rows, 'period')} {'is' if lost == 1 else 'are'} without a sample"
    if late:
        instants = "its instant" if late == 1 else "their instants"
        yield f"{counted(late, 'sample')} came too late for {instants}"


def _place(start: int, stop: int, period_s: float) -> str:
    if stop - start == 1:
        return f"at {instant(start, period_s)}"
    return f"from {instant(start, period_s)} to {instant(stop - 1, period_s)}"


def filled_pieces(pieces: Iterable[Rows]) -> Iterator[Rows]:
    """Fill the short holes of inputs and outputs that come in pieces, as `filled` does.

    Parameters
    ----------
    pieces : iterable of (u, y)
        Consecutive rows; NaN in `y` is missing. Unusable rows become NaN throughout.
    """
    context: Rows | None = None
    new = 0
    for piece in pieces:
        if not len(piece[0]):
            continue
        u, y = piece if context is None else joined([context, piece])
        ready = len(u) - CONTEXT
        if ready > new:
            whole = _usable(y)
            yield u[new:ready], whole[new:ready]
            keep = max(0, ready - CONTEXT)
            context, new = (u[keep:], y[keep:]), ready - keep
        else:
            context = (u, y)
    if context is not None:
        yield context[0][new:], _usable(context[1])[new:]


def _usable(y: FloatArray) -> FloatArray:
    missing = np.isnan(y)
    if not missing.any():
        return y
    whole = filled(y, missing) if not missing.all(axis=0).any() else y.copy()
    whole[unusable_rows(missing)] = np.nan
    return whole


def _between(known: NDArray[np.intp], values: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
    """Return one channel at rows between those at which it is known."""
    found = np.interp(rows, known, values)
    after = np.searchsorted(known, rows)
    inside = (after >= 2) & (after <= len(known) - 2)  # noqa: PLR2004 - two on either side
    places = after[inside, np.newaxis] + np.array([-2, -1, 0, 1])
    nodes = known[places]
    is_short = np.all(np.diff(nodes, axis=1) <= _REACH, axis=1)
    at = np.flatnonzero(inside)[is_short]
    found[at] = lagrange(
        nodes[is_short].astype(np.float64), values[places[is_short]], rows[at].astype(np.float64)
    )
    return found


def lagrange(nodes: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Evaluate polynomials, each at one point, by the values at their nodes.

    Parameters
    ----------
    nodes : ndarray, (polynomials, points)
        Places of the values, all different in a row.
    values : ndarray, (polynomials, points) or (polynomials, points, channels)
        Values at the nodes.
    at : ndarray, (polynomials,)
        Places of the evaluation.

    Returns
    -------
    ndarray, (polynomials,) or (polynomials, channels)
        Values of the polynomials.
    """
    points = nodes.shape[1]
    weights = np.ones(nodes.shape)
    for i in range(points):
        for j in range(points):
            if i != j:
                weights[:, i] *= (at - nodes[:, j]) / (nodes[:, i] - nodes[:, j])
    return np.asarray(np.einsum("pi,pi...->p...", weights, values))


def joined(pieces: Sequence[Rows]) -> Rows:
    """Return pieces of u and y, one or more, as one."""
    if len(pieces) == 1:
        return pieces[0]
    return np.concatenate([u for u, _ in pieces]), np.concatenate([y for _, y in pieces])
