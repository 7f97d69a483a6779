"""Timetable of a record: rows of its samples, and the inputs that act there.

One rule serves records that are read as a whole and in pieces. A first pass takes the messages'
numbers and stamps, which give the timetable; a second one turns the messages into rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.clock import NS
from flexarm_core.errors import DataError
from flexarm_ident.reading.grid import held, longest_run, notices, on_grid, place
from flexarm_ident.records.holes import joined

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.reading.grid import Grid, Run
    from flexarm_ident.records.data_warning import DataWarning

    Integers = NDArray[np.int64]
    Rows = tuple[FloatArray, FloatArray]

# A step between two samples, in periods, in which another one should have been.
_HOLE = 1.5
# So many commands for each period of a hole, and the loop ran while nothing was recorded.
_RUNNING = 0.5
# A command that comes later after its sample, in periods, found the sampling stopped.
_PROMPT = 1.0
# Samples on either side that have a part in a row, and one more for the input behind.
_CONTEXT = 4


class Marks(NamedTuple):
    """Numbers, stamps and sending of a topic's messages in their order, (messages,) each.

    `command_sequence` is that of the command in force, zero without one.
    """

    sequence: Integers
    stamps_ns: Integers
    sent_ns: Integers
    command_sequence: Integers


class Answers(NamedTuple):
    """Recorded commands: own number, sample they answer, instant of sending, and values.

    Each is (commands,), `values` (commands, 2 inputs): commands within their limits, compensations.
    """

    sequence: Integers
    state_sequence: Integers
    sent_ns: Integers
    values: FloatArray


class Changes(NamedTuple):
    """Inputs without a recorded sample: instants of change and values, (changes, inputs)."""

    instants: FloatArray
    values: FloatArray


@dataclass(frozen=True, eq=False)
class Timetable:
    """Places of the samples of a record.

    Attributes
    ----------
    run : Run
        The messages that are used.
    grid : Grid
        Their instants.
    rows : int
        Rows of the record.
    input_behind : bool
        The input of a sample stands in the message behind it.
    changes : Changes
        Inputs inside holes.
    unheeded : ndarray of bool, (kept samples,)
        Samples whose answer did not act before the next one was taken: the input before goes on.
    underway : ndarray of bool, (kept samples,)
        Samples before a hole in which inputs went on changing; `changes` has some of them.
    notices : tuple of DataWarning
        Defects of the record.
    """

    run: Run
    grid: Grid
    rows: int
    input_behind: bool
    changes: Changes
    unheeded: NDArray[np.bool_]
    underway: NDArray[np.bool_]
    notices: tuple[DataWarning, ...]


def timetable(
    marks: Marks, *, answers: Callable[[Integers], Answers] | None = None, input_behind: bool
) -> Timetable:
    """Return the timetable of the longest run of rising numbers.

    Parameters
    ----------
    marks : Marks
        Marks of all messages.
    answers : callable or None
        Returns the recorded commands that answer samples from one number up to another, exclusive;
        called with the numbers before and behind all holes, (holes, 2), where there are any.
    input_behind : bool
        The input of a sample stands in the message behind it, so that the last one has none.

    Raises
    ------
    DataError
        If there are too few samples, or the stamps do not advance.
    """
    run = longest_run(marks.sequence)
    used = Marks(*(each[run.messages] for each in marks))
    fewest = 3 if input_behind else 2
    if len(used.sequence) < fewest:
        raise DataError(f"only {len(used.sequence)} samples follow each other; record again")
    grid = place(used.sequence, used.stamps_ns)
    kept = Marks(*(each[grid.kept] for each in used))
    changes, unheeded, underway = _inside_holes(grid, kept, answers)
    rows = grid.rows - (1 if input_behind else 0)
    if rows < 1:
        raise DataError("only one sample is left on the grid of the stamps; record again")
    said = notices(run, grid, len(marks.sequence))
    return Timetable(run, grid, rows, input_behind, changes, unheeded, underway, said)


def record_rows(table: Timetable, pieces: Iterable[Rows]) -> Iterator[Rows]:
    """Yield the rows of the grid, u and y, from messages; y is NaN where nothing was measured.

    Parameters
    ----------
    table : Timetable
        Places of the messages.
    pieces : iterable of (inputs, outputs)
        Columns of all messages of the topic, in the order of sending and in pieces of any length.
    """
    context: Rows | None = None
    # Kept samples that have left the context, and rows that were given out.
    left, given = 0, 0
    for piece in _kept(table, pieces):
        u, y = piece if context is None else joined([context, piece])
        if len(y) <= 2 * _CONTEXT:
            context = (u, y)
            continue
        ready = int(np.rint(table.grid.instants[left + len(y) - 1 - _CONTEXT]))
        yield _section(table, (u, y), left, range(given, ready))
        given = max(given, ready)
        keep = max(0, len(y) - 3 * _CONTEXT)
        context, left = (u[keep:], y[keep:]), left + keep
    if context is not None and given < table.rows:
        yield _section(table, context, left, range(given, table.rows))


def _kept(table: Timetable, pieces: Iterable[Rows]) -> Iterator[Rows]:
    first = 0
    start = table.run.messages.start
    for u, y in pieces:
        here = np.arange(first, first + len(y)) - start
        inside = (here >= 0) & (here < len(table.grid.kept))
        inside[inside] = table.grid.kept[here[inside]]
        if inside.any():
            yield u[inside], y[inside]
        first += len(y)


def _section(table: Timetable, samples: Rows, left: int, rows: range) -> Rows:
    """Return some rows, from samples that reach beyond them on both sides."""
    u, y = samples
    here = slice(left, left + len(y))
    instants, unheeded = table.grid.instants[here], table.unheeded[here]
    wanted = np.arange(rows.start, max(rows.start, rows.stop))
    if table.input_behind:
        before, behind = u[:-1], u[1:]
        acting = np.where(unheeded[:-1, np.newaxis], before, behind)
        since = instants[:-1]
    else:
        acting, since = u, instants
    bridges = [
        _bridge(table.changes, instants[at : at + 2], u[at : at + 2])
        for at in np.flatnonzero(table.underway[here][:-1]).tolist()
    ]
    if bridges:
        since = np.concatenate([since, *(bridge.instants for bridge in bridges)])
        acting = np.concatenate([acting, *(bridge.values for bridge in bridges)])
        # What is known of a hole stands behind the guess of its first sample.
        order = np.argsort(since, kind="stable")
        since, acting = since[order], acting[order]
    return held(since, acting, wanted), on_grid(instants, y, wanted)


def _bridge(known: Changes, edges: FloatArray, in_force: FloatArray) -> Changes:
    """Return inputs inside a hole in which they went on changing: known ones, with lines between.

    The first edge's input in force acted until it, the second one's in the period before it.
    """
    inside = (known.instants >= edges[0]) & (known.instants < edges[1])
    at = np.concatenate([[edges[0] - 1.0], known.instants[inside], [edges[1] - 1.0]])
    values = np.vstack([in_force[:1], known.values[inside], in_force[1:]])
    instants = np.arange(edges[0], edges[1])
    lines = [np.interp(instants, at, column) for column in values.T]
    return Changes(instants, np.stack(lines, axis=1))


def _inside_holes(
    grid: Grid, marks: Marks, answers: Callable[[Integers], Answers] | None
) -> tuple[Changes, NDArray[np.bool_], NDArray[np.bool_]]:
    """Reconstruct the drive's inputs while no sample was recorded.

    When samples were taken and lost, as the count of the commands shows, their commands may be
    recorded; inputs between known ones are interpolated. When no samples were taken, a command that
    was sent more than a period after its own sample acted only when the sampling went on.
    """
    unheeded, underway = np.zeros((2, len(grid.instants)), dtype=np.bool_)
    instants: list[FloatArray] = []
    values: list[FloatArray] = []
    holes = np.flatnonzero(np.diff(grid.instants) > _HOLE)
    if answers is None or not len(holes):
        return Changes(np.empty(0), np.empty((0, 0))), unheeded, underway
    found = answers(np.stack([marks.sequence[holes], marks.sequence[holes + 1]], axis=1))
    order = np.argsort(found.state_sequence, kind="stable")
    answered = found.state_sequence[order]
    for at in holes.tolist():
        gap = grid.instants[at + 1] - grid.instants[at]
        went_on = marks.command_sequence[at + 1] - marks.command_sequence[at]
        first, last = np.searchsorted(answered, marks.sequence[at : at + 2], side="left")
        own = order[first:last]
        if went_on > _RUNNING * gap:
            ahead = found.state_sequence[own] - marks.sequence[at]
            known = ahead < gap
            instants.append(grid.instants[at] + ahead[known])
            values.append(found.values[own[known]])
            underway[at] = True
        elif len(own):
            late_s = (found.sent_ns[own[-1]] - marks.sent_ns[at]) / NS
            acted = found.sequence[own[-1]] == marks.command_sequence[at + 1]
            unheeded[at] = acted and late_s > _PROMPT * grid.period_s
    changes = Changes(
        np.concatenate([np.empty(0), *instants]), np.concatenate([found.values[:0], *values])
    )
    return changes, unheeded, underway
