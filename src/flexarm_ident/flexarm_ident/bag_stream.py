"""A recorded experiment that is read piece by piece, for records larger than memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.errors import DataError
from flexarm_ident.iodata import ARM_OUTPUTS
from flexarm_ident.sampling import Jitter, Run, lost_samples, sampling_period_s
from flexarm_ident.source import even_chunks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from flexarm_ident.alignment import Channels, Recorded
    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.data_warning import DataWarning

    Rows = tuple[FloatArray, FloatArray]
    Align = Callable[[Iterable[Recorded]], Iterator[Rows]]

_FEWEST_SAMPLES = 3


@dataclass(frozen=True, eq=False)
class BagStream:
    """The longest part of a bag without a gap, as a `Source`.

    Attributes
    ----------
    inputs, outputs : tuple of str
        Channel names.
    dt_s : float
        Sampling period.
    label : str
        Name of the record in messages.
    closed_loop : bool, optional
        Whether the inputs were computed from the outputs; None when it is not known.
    notices : tuple of DataWarning
        What the user should know.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt_s: float
    label: str
    closed_loop: bool | None
    notices: tuple[DataWarning, ...]
    _rows: range = field(repr=False)
    _open: Callable[[], Iterator[Rows]] = field(repr=False)

    def __len__(self) -> int:
        return len(self._rows)

    def chunks(self, samples: int) -> Iterator[Rows]:
        """Return u and y from the start, `samples` rows each, the last pair with the rest."""
        return even_chunks(self._used(), samples)

    def _used(self) -> Iterator[Rows]:
        first = 0
        for u, y in self._open():
            here = slice(max(self._rows.start - first, 0), max(self._rows.stop - first, 0))
            yield u[here], y[here]
            first += len(u)
            if first >= self._rows.stop:
                return


def open_stream(
    pieces: Callable[[], Iterator[Recorded]],
    align: Align,
    channels: Channels | None,
    *,
    closed_loop: bool | None,
    source: str,
) -> BagStream:
    """Go through the messages once and return the source.

    Parameters
    ----------
    pieces
        Starts to read the messages of the topic in the order of sending.
    align
        `arm_rows` or `io_rows`.
    channels
        Names of the arrays in ``IoSample``; None for ``ArmState`` or when they were not recorded.
    closed_loop
        Whether the inputs were computed from the outputs; None when it is not known.
    source
        Name of the record.

    Returns
    -------
    BagStream
        The record.

    Raises
    ------
    DataError
        If fewer than three samples follow each other, names do not fit, or a value is not finite.
    """
    survey = _Survey()
    for piece in pieces():
        survey.add(piece)
    run = survey.longest
    # The input of the arm's last sample is in the message behind it.
    behind = 1 if align is arm_rows else 0
    rows = range(run.start, run.stop - behind)
    if len(rows) < _FEWEST_SAMPLES:
        raise DataError(f"{source}: only {len(rows)} samples follow each other; record again")
    u, y = next(align(pieces()))
    inputs, outputs = _names(u, y, channels, is_arm=align is arm_rows)
    if (len(inputs), len(outputs)) != (u.shape[1], y.shape[1]):
        raise DataError(
            f"{source}: {u.shape[1]} inputs and {y.shape[1]} outputs, but {len(inputs)} and "
            f"{len(outputs)} names"
        )
    stream = BagStream(
        inputs,
        outputs,
        survey.period_s(),
        source,
        closed_loop,
        survey.notices(),
        rows,
        lambda: align(pieces()),
    )
    first = 0
    for u, y in stream.chunks(1 << 14):
        for names, values in ((inputs, u), (outputs, y)):
            bad = np.argwhere(~np.isfinite(values))
            if len(bad):
                row, channel = bad[0]
                raise DataError(f"{source}: {names[channel]} is not finite in row {first + row}")
        first += len(u)
    return stream


def arm_rows(pieces: Iterable[Recorded]) -> Iterator[Rows]:
    """Return u and y from ``ArmState``: the input of a sample stands in the message behind it."""
    waiting = np.empty((0, len(ARM_OUTPUTS)))
    for piece in pieces:
        u = (piece.real("command_v") - piece.real("compensation_v"))[:, np.newaxis]
        y = np.column_stack([piece.real(name) for name in ARM_OUTPUTS])
        yield u[len(u) - len(waiting) - len(y) + 1 :], np.concatenate([waiting, y[:-1]])
        waiting = y[-1:]


def io_rows(pieces: Iterable[Recorded]) -> Iterator[Rows]:
    """Return u and y from ``IoSample``."""
    for piece in pieces:
        yield piece.real("inputs"), piece.real("outputs")


def _names(
    u: FloatArray, y: FloatArray, channels: Channels | None, *, is_arm: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    if is_arm:
        return ("command_v",), ARM_OUTPUTS
    if channels is not None:
        return channels.inputs, channels.outputs
    return (
        tuple(f"input_{index + 1}" for index in range(u.shape[1])),
        tuple(f"output_{index + 1}" for index in range(y.shape[1])),
    )


class _Survey:
    """Gaps and sampling period of messages that pass by in pieces."""

    def __init__(self) -> None:
        self.longest = range(0)
        self._run = range(0)
        # Sequence number and stamp of the last message.
        self._last = np.empty((0, 2), dtype=np.int64)
        self._seen = self._breaks = self._lost = 0
        self._jitter = Jitter()
        self._periods_s: list[float] = []

    def add(self, piece: Recorded) -> None:
        marks = np.stack([piece.integer("sequence"), piece.stamps_ns()], axis=1)
        joined = np.concatenate([self._last, marks])
        steps, steps_ns = np.diff(joined, axis=0).T
        for start in (np.flatnonzero(steps != 1) + 1 + self._seen - len(self._last)).tolist():
            self._close(start)
            self._breaks += 1
        self._lost += int(np.sum(steps[steps > 1] - 1))
        self._seen += len(marks)
        self._run = range(self._run.start, self._seen)
        self._last = marks[-1:]
        if len(self._run) > len(self.longest):
            self.longest = self._run
        steps_ns = steps_ns[steps == 1]
        if len(steps_ns):
            self._jitter.add(steps_ns)
            period_s, _ = sampling_period_s(np.cumsum(np.append(0, steps_ns)))
            self._periods_s.append(period_s)

    def _close(self, end: int) -> None:
        if end - self._run.start > len(self.longest):
            self.longest = range(self._run.start, end)
        self._run = range(end, end)

    def period_s(self) -> float:
        return float(np.median(self._periods_s))

    def notices(self) -> tuple[DataWarning, ...]:
        run = Run(slice(self.longest.start, self.longest.stop), self._breaks, self._lost)
        return (*lost_samples(run, self._seen), *self._jitter.warnings(self.period_s()))
