"""Alignment of recorded messages: which input acts on which sample of a record, and when.

The rows are the same for messages as a whole and in pieces.

Of a record that is larger than memory only the instants of its samples stay there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.clock import NS
from flexarm_core.errors import DataError
from flexarm_core.labels import without_dots
from flexarm_ident.reading.timetable import Answers, Marks, Timetable, record_rows, timetable
from flexarm_ident.reading.wraps import found_wraps, unwrapped, wrap_notices
from flexarm_ident.records.data_warning import SAMPLING
from flexarm_ident.records.holes import CONTEXT, filled_pieces, joined
from flexarm_ident.records.iodata import ARM_OUTPUTS, IoData
from flexarm_ident.records.source import even_chunks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_bags.reader import Channels, Recorded
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.reading.wraps import Wrap
    from flexarm_ident.records.data_warning import DataWarning

    Rows: TypeAlias = tuple[FloatArray, FloatArray]
    Pieces: TypeAlias = Callable[[], Iterable[Recorded]]
    """Starts to read the messages of a topic, in the order of sending."""

# A declared rate further off than this from the stamps is worth a warning.
RATE_TOLERANCE = 1e-2


class _CommandKind(NamedTuple):
    """Members of a command's message, and the largest command that the gate lets pass."""

    answered: str
    effort: str
    compensation: str
    reach: float


_ARM_COMMAND = _CommandKind("state_sequence", "effort_v", "compensation_v", MAX_COMMAND_V)
_IO_COMMAND = _CommandKind("sample_sequence", "efforts", "compensations", np.inf)


@dataclass(frozen=True)
class BagReading:
    """A record with the counts of its messages.

    Attributes
    ----------
    data : IoData
        The record; its `notices` report defects.
    samples : int
        Samples on the topic, used or not.
    lost : int
        Difference of periods and samples in the used run, at least 0.
    duration_s : float
        From the first to the last stamp on the topic.
    unanswered : int
        Samples whose own command was not in force at the next one; 0 for ``IoSample``, which has
        no commands.
    """

    data: IoData
    samples: int
    lost: int
    duration_s: float
    unanswered: int = 0

    @property
    def warnings(self) -> tuple[str, ...]:
        """Defects of the record, one line each."""
        return tuple(notice.text for notice in self.data.notices)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Places of a topic's messages in the record.

    Attributes
    ----------
    header : Header
        Facts of the record; for our own rig without the kind of its loop.
    marks : Marks
        Numbers and stamps of the messages.
    table : Timetable
        Places of the samples.
    is_running : bool
        The samples are those of a running rig, whose inputs were in force while they were taken:
        ``ArmState``, or ``IoSample`` with compensations. Else they are those of an import.
    columns : callable
        Reading of inputs, with compensations behind them, and outputs from the messages.
    wraps : tuple of Wrap
        Outputs whose turns are counted; empty for our own rig.
    """

    header: Header
    marks: Marks
    table: Timetable
    is_running: bool
    columns: Callable[[Recorded], Rows]
    wraps: tuple[Wrap, ...] = ()

    def efforts(self, pieces: Iterable[Recorded]) -> Iterator[Rows]:
        """Return inputs, without compensation, and outputs; rows of the grid."""
        if not self.is_running:
            return self._rows(pieces)
        width = len(self.header.inputs)
        return ((u[:, :width] - u[:, width:], y) for u, y in self._rows(pieces))

    def loop_kind(self, declared: Sequence[bool]) -> bool | None:
        """Return True when the inputs were computed from the outputs; None when nobody says it.

        Parameters
        ----------
        declared : sequence of bool
            Use of the outputs by each declared commander; empty without a declaration.
        """
        if not self.is_running:
            return self.header.closed_loop
        return any(declared) if declared else None

    def reading(
        self,
        samples: Recorded,
        *,
        reference: Recorded | None = None,
        tracked: Sequence[str] = (),
        declared: Sequence[bool] = (),
        changes: Sequence[DataWarning] = (),
    ) -> BagReading:
        """Return the whole record in memory; for our own rig with compensation and reference.

        Parameters
        ----------
        samples : Recorded
            All messages of the topic.
        reference : Recorded, optional
            ``Float64`` or ``Float64MultiArray`` messages, sent when the reference changes, before
            the command that answers a sample.
        tracked : sequence of str
            Outputs that set-points are for, as of `IoData`.
        declared : sequence of bool
            As in `loop_kind`.
        changes : sequence of DataWarning
            What the bag says of the run besides.

        Raises
        ------
        DataError
            If arrays do not fit the names, or a value is not finite.
        """
        header = self.header
        u, y = joined(list(self._rows([samples])))
        lost, duration_s = self.table.grid.lost, _duration_s(self.marks.stamps_ns)
        if not self.is_running:
            missing = self.table.grid.missing
            data = header.record(u, y, input_held=missing if missing.any() else None)
            return BagReading(data, len(samples), lost, duration_s)
        followed: FloatArray | None = None
        if reference is not None and len(reference):
            log_times_ns = samples.log_times_ns[self.table.run.messages][self.table.grid.kept]
            followed = _references(reference, self.table, log_times_ns)
        notices = (*header.notices, *changes)
        width = len(header.inputs)
        data = header.record(
            *(u[:, :width], y),
            compensation=u[:, width:],
            reference=followed,
            tracked=tracked if followed is not None else (),
            notices=notices,
        )
        data = replace(data, closed_loop=self.loop_kind(declared))
        steps, in_force = np.diff(self.marks.sequence), np.diff(self.marks.command_sequence)
        unanswered = int(np.sum((steps == 1) & (in_force < 1)))
        return BagReading(data, len(samples), lost, duration_s, unanswered)

    def _rows(self, pieces: Iterable[Recorded]) -> Iterator[Rows]:
        return record_rows(self.table, unwrapped(map(self.columns, pieces), self.wraps))


def arm_alignment(states: Pieces, commands: Pieces, *, source: str) -> Alignment:
    """Align the messages of our own rig.

    ``ArmState.command_v`` is in force while a sample is taken: the answer to the sample before. The
    input that acts from sample k on stands therefore in message k + 1, and the last message gives
    its input only.

    Parameters
    ----------
    states : callable
        Starts to read the ``ArmState`` messages.
    commands : callable
        Starts to read the ``MotorCommand`` messages, for the drive's inputs in holes; called only
        where there are holes.
    source : str
        Name of the record.

    Raises
    ------
    DataError
        If fewer than three samples follow each other.
    """
    marks = _marks(states())
    table = timetable(
        marks,
        answers=lambda numbers: _answers(commands(), numbers, _ARM_COMMAND),
        input_behind=True,
    )
    header = Header(("command_v",), ARM_OUTPUTS, table.grid.period_s, None, source, table.notices)
    return Alignment(header, marks, table, is_running=True, columns=_arm_columns)


def io_alignment(
    samples: Pieces,
    channels: Channels | None,
    *,
    source: str,
    commands: Pieces = tuple,
    wrap: float | None = None,
) -> Alignment:
    """Align the messages of any other rig.

    The inputs of an imported record act from their own sample on, those of a running rig as in
    `arm_alignment`.

    Parameters
    ----------
    samples : callable
        Starts to read the ``IoSample`` messages; NaN in an output is not measured.
    channels : Channels or None
        Names and rate; None when they were not recorded.
    source : str
        Name of the record.
    commands : callable
        Starts to read the ``IoCommand`` messages of a running rig, as in `arm_alignment`.
    wrap : float, optional
        Period at which outputs wrap, as in `found_wraps`.

    Raises
    ------
    DataError
        If fewer than two samples follow each other.
    """
    marks = _marks(samples())
    first = next(iter(samples()))
    is_running = first.has("compensations") and first.real("compensations").shape[1] > 0
    columns = _running_columns if is_running else _io_columns
    table = timetable(
        marks,
        answers=(lambda numbers: _answers(commands(), numbers, _IO_COMMAND))
        if is_running
        else None,
        input_behind=is_running,
    )
    u, y = _io_columns(first)
    header = _io_header(table, channels, (u.shape[1], y.shape[1]), source)
    wraps = found_wraps(map(columns, samples()), wrap)
    notices = (*header.notices, *wrap_notices(header.outputs, wraps))
    header = replace(header, notices=notices)
    return Alignment(header, marks, table, is_running, columns, tuple(wraps))


def _arm_columns(piece: Recorded) -> Rows:
    """Return command and compensation as two columns, and the outputs."""
    return (
        np.column_stack([piece.real("command_v"), piece.real("compensation_v")]),
        np.column_stack([piece.real(name) for name in ARM_OUTPUTS]),
    )


def _running_columns(piece: Recorded) -> Rows:
    """Return commands and their compensations, and the outputs."""
    return np.hstack([piece.real("inputs"), piece.real("compensations")]), piece.real("outputs")


def _io_columns(piece: Recorded) -> Rows:
    return piece.real("inputs"), piece.real("outputs")


def _io_header(
    table: Timetable, channels: Channels | None, widths: tuple[int, int], source: str
) -> Header:
    """Return the facts of a record, with the declared rate where it is that of the stamps."""
    dt_s, notices = table.grid.period_s, list(table.notices)
    if channels is None:
        inputs, outputs = (
            tuple(f"{kind}_{index + 1}" for index in range(width))
            for kind, width in zip(("input", "output"), widths, strict=True)
        )
        return Header(inputs, outputs, dt_s, None, source, tuple(notices))
    if channels.rate_hz > 0:
        if abs(channels.rate_hz * dt_s - 1) > RATE_TOLERANCE:
            text = (
                f"ChannelInfo says {channels.rate_hz:g} Hz, the stamps {1 / dt_s:g} Hz: used the"
                " stamps"
            )
            figures = {"declared_hz": channels.rate_hz, "stamped_hz": 1 / dt_s}
            notices.append(SAMPLING(text, figures))
        else:
            dt_s = 1 / channels.rate_hz
    label = f"{source} ({channels.source})" if channels.source else source
    return Header(
        without_dots(channels.inputs),
        without_dots(channels.outputs),
        dt_s,
        channels.closed_loop,
        label,
        tuple(notices),
    )


def _marks(pieces: Iterable[Recorded]) -> Marks:
    """Return numbers and stamps of messages that come in pieces."""
    columns = [
        (
            piece.integer("sequence"),
            piece.stamps_ns(),
            piece.log_times_ns,
            piece.integer("command_sequence")
            if piece.has("command_sequence")
            else np.zeros(len(piece), dtype=np.int64),
        )
        for piece in pieces
    ]
    if not sum(len(sequence) for sequence, *_ in columns):
        raise DataError("no messages on the topic")
    return Marks(*(np.concatenate(each) for each in zip(*columns, strict=True)))


def _answers(pieces: Iterable[Recorded], numbers: NDArray[np.int64], kind: _CommandKind) -> Answers:
    """Return the recorded commands that answer samples of some rising ranges of numbers."""
    integers: list[NDArray[np.int64]] = [np.empty((0, 3), dtype=np.int64)]
    values: list[FloatArray] = []
    for piece in pieces:
        answered = piece.integer(kind.answered)
        within = np.searchsorted(numbers[:, 0], answered, side="right") - 1
        asked = (within >= 0) & (answered < numbers[within.clip(min=0), 1])
        changes = np.column_stack([piece.integer("sequence"), answered, piece.log_times_ns])
        integers.append(changes[asked])
        compensations = piece.real(kind.compensation).reshape(len(piece), -1)
        commands = piece.real(kind.effort).reshape(len(piece), -1) + compensations
        both = np.hstack([commands, compensations]).clip(-kind.reach, kind.reach)
        values.append(both[asked])
    sequence, state_sequence, sent_ns = np.concatenate(integers).T
    width = values[0].shape[1] if values else 2
    return Answers(
        sequence, state_sequence, sent_ns, np.concatenate([np.empty((0, width)), *values])
    )


def _duration_s(stamps_ns: NDArray[np.int64]) -> float:
    return float(stamps_ns[-1] - stamps_ns[0]) / NS


def _references(
    reference: Recorded, table: Timetable, log_times_ns: NDArray[np.int64]
) -> FloatArray:
    """Return the last reference sent before the sample that follows, or the first one, by row."""
    start_ns = log_times_ns[0]
    next_ns = np.interp(np.arange(1, table.rows + 1), table.grid.instants, log_times_ns - start_ns)
    order = np.argsort(reference.log_times_ns, kind="stable")
    sent_ns = (reference.log_times_ns[order] - start_ns).astype(np.float64)
    latest = np.searchsorted(sent_ns, next_ns, side="left") - 1
    return np.asarray(reference.real("data")[order][np.maximum(latest, 0)])


@dataclass(frozen=True, eq=False)
class Header:
    """Facts of a record beside its rows, as in `IoData`."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt_s: float
    closed_loop: bool | None
    source: str
    notices: tuple[DataWarning, ...]

    @property
    def label(self) -> str:
        """Name of the record in messages."""
        return self.source

    @property
    def facts(self) -> dict[str, Any]:
        """The fields by their names."""
        return {each.name: getattr(self, each.name) for each in fields(Header)}

    def record(self, u: FloatArray, y: FloatArray, **others: Any) -> IoData:  # noqa: ANN401
        """Return inputs and outputs, and other fields of `IoData`, as a record."""
        return IoData(u, y, **{**self.facts, **others})

    def leading(self, pieces: Iterable[Rows], samples: int) -> IoData:
        """Return the first rows of a record in pieces, without compensation."""
        # Rows behind the last one tell how a hole before it is filled.
        taken, left = [], samples + CONTEXT
        for u, y in pieces:
            taken.append((u[:left], y[:left]))
            left -= len(u)
            if left <= 0:
                break
        return self.record(*joined(taken)).head(samples)

    def check(self, pieces: Iterable[Rows]) -> None:
        """Go through a record once, to make sure that it is usable.

        Parameters
        ----------
        pieces : iterable of (u, y)
            All its rows; NaN in y is not measured.

        Raises
        ------
        DataError
            If names do not fit, an input is not finite, an output is infinite or was never
            measured.
        """
        first = 0
        measured = np.zeros(len(self.outputs), dtype=np.bool_)
        for u, y in pieces:
            if (u.shape[1], y.shape[1]) != (len(self.inputs), len(self.outputs)):
                raise DataError(
                    f"{self.source}: {u.shape[1]} inputs and {y.shape[1]} outputs, but "
                    f"{len(self.inputs)} and {len(self.outputs)} names"
                )
            for names, wrong in ((self.inputs, ~np.isfinite(u)), (self.outputs, np.isinf(y))):
                bad = np.argwhere(wrong)
                if len(bad):
                    row, channel = bad[0]
                    raise DataError(
                        f"{self.source}: {names[channel]} is not finite in row {first + row}"
                    )
            measured |= ~np.isnan(y).all(axis=0)
            first += len(u)
        for name, ever in zip(self.outputs, measured, strict=True):
            if not ever:
                raise DataError(f"{self.source}: {name} was never measured: leave it out")


@dataclass(frozen=True, eq=False)
class BagStream(Header):
    """Record of a bag as a `Source`, equal to that of `read_bag` without the compensation."""

    _rows: int = field(repr=False)
    _open: Callable[[], Iterator[Rows]] = field(repr=False)

    def __len__(self) -> int:
        return self._rows

    @property
    def whole_samples(self) -> int:
        """Number of samples: a bag is read from its first one to its last."""
        return self._rows

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples as a record in memory (all if there are fewer)."""
        return replace(self.leading(self._open(), samples), head_of=self._rows)

    def chunks(self, samples: int) -> Iterator[Rows]:
        """Return u and y from the start, `samples` rows each, as `Samples.chunks` says."""
        return even_chunks(filled_pieces(self._open()), samples)
