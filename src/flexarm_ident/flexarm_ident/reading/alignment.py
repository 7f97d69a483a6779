"""From recorded columns to an experiment's record: which input acts on which sample, and when."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from flexarm_core.errors import DataError
from flexarm_ident.reading.loop_kind import loop_kind
from flexarm_ident.reading.timetable import Answers, Marks, Timetable, record_rows, timetable
from flexarm_ident.records.iodata import ARM_OUTPUTS, DataWarning, IoData
from flexarm_ident.records.source import joined

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_bags.reader import Channels, Recorded
    from flexarm_core.arrays import FloatArray

# A declared rate further off than this from the stamps is worth a warning.
RATE_TOLERANCE = 1e-2
_NS = 1_000_000_000
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class BagReading:
    """A record and how it was obtained.

    Attributes
    ----------
    data
        The record; its `notices` are what the user should know.
    samples
        Samples on the topic, used or not.
    lost
        So many fewer samples than periods there are in the used run.
    duration_s
        From the first to the last stamp on the topic.
    unanswered
        Samples whose own command was not in force at the next one; 0 for ``IoSample``, which
        tells nothing of commands.
    """

    data: IoData
    samples: int
    lost: int
    duration_s: float
    unanswered: int = 0

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know, one line each."""
        return tuple(notice.text for notice in self.data.notices)


@dataclass(frozen=True)
class Header:
    """What is known of a record beside its rows: fields of `IoData` of the same names."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt_s: float
    closed_loop: bool | None
    source: str
    notices: tuple[DataWarning, ...]

    def record(self, u: FloatArray, y: FloatArray, **others: Any) -> IoData:  # noqa: ANN401
        """Return inputs and outputs, and other fields of `IoData`, as a record."""
        return IoData(u, y, **{**vars(self), **others})


def marks(pieces: Iterable[Recorded]) -> Marks:
    """Return numbers and stamps of messages that pass by in pieces.

    Raises
    ------
    DataError
        If there are no messages.
    """
    columns = [
        (
            piece.integer("sequence"),
            piece.stamps_ns(),
            piece.integer("command_sequence")
            if piece.has("command_sequence")
            else np.zeros(len(piece), dtype=np.int64),
        )
        for piece in pieces
    ]
    if not sum(len(sequence) for sequence, _, _ in columns):
        raise DataError("no messages on the topic")
    return Marks(*(np.concatenate(each) for each in zip(*columns, strict=True)))


def answers(pieces: Iterable[Recorded], numbers: NDArray[np.int64]) -> Answers:
    """Return what the drive was told in answer to some samples.

    Parameters
    ----------
    pieces
        ``MotorCommand`` messages.
    numbers : (ranges, 2)
        Rising ranges of numbers of samples, the second one exclusive.

    Returns
    -------
    Answers
        The commands that answer samples of these numbers.
    """
    integers: list[NDArray[np.int64]] = [np.empty((0, 3), dtype=np.int64)]
    values_v: list[FloatArray] = [np.empty((0, 2))]
    for piece in pieces:
        answered = piece.integer("state_sequence")
        within = np.searchsorted(numbers[:, 0], answered, side="right") - 1
        asked = (within >= 0) & (answered < numbers[within.clip(min=0), 1])
        told = np.column_stack([piece.integer("sequence"), answered, piece.stamps_ns()])
        integers.append(told[asked])
        compensation_v = piece.real("compensation_v")
        command_v = piece.real("effort_v") + compensation_v
        values_v.append(np.column_stack([command_v, compensation_v])[asked])
    sequence, state_sequence, stamps_ns = np.concatenate(integers).T
    return Answers(sequence, state_sequence, stamps_ns, np.concatenate(values_v))


def arm_timetable(found: Marks, commands: Callable[[], Iterable[Recorded]]) -> Timetable:
    """Return the timetable of ``ArmState`` messages: their inputs stand in the messages behind.

    Parameters
    ----------
    found
        Their numbers and stamps.
    commands
        Starts to read the ``MotorCommand`` messages; called where there are holes.

    Returns
    -------
    Timetable
        Where the samples stand.
    """
    return timetable(found, answers=lambda numbers: answers(commands(), numbers), input_behind=True)


def arm_rows(
    table: Timetable, pieces: Iterable[Recorded]
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Return command with compensation, and outputs, from ``ArmState``; rows of the grid."""
    columns = (
        (
            np.column_stack([piece.real("command_v"), piece.real("compensation_v")]),
            np.column_stack([piece.real(name) for name in ARM_OUTPUTS]),
        )
        for piece in pieces
    )
    return record_rows(table, columns)


def arm_header(table: Timetable, source: str) -> Header:
    """Return what is known of a record of our own rig but the kind of its loop."""
    return Header(("command_v",), ARM_OUTPUTS, table.grid.period_s, None, source, table.notices)


def arm_reading(
    state: Recorded,
    reference: Recorded | None,
    commands: Callable[[], Iterable[Recorded]],
    *,
    declared: Sequence[bool],
    source: str,
) -> BagReading:
    """Return the record of our own rig.

    ``ArmState.command_v`` is in force while a sample is taken: the answer to the sample before. The
    input that acts from sample k on stands therefore in message k + 1, and the last message gives
    its input only.

    Parameters
    ----------
    state
        ``ArmState`` messages in the order in which they were sent.
    reference
        ``Float64`` messages, sent before the command that answers a sample, when it changes.
    commands
        Gives the ``MotorCommand`` messages, for what the drive did while samples are missing.
    declared
        Of everybody who commanded, whether the commands were computed from the outputs; empty when
        nobody declared it.
    source
        Name of the record.

    Returns
    -------
    BagReading
        With compensation, and reference when there is one.

    Raises
    ------
    DataError
        If fewer than three samples follow each other or a value is not finite.
    """
    found = _named(lambda: marks([state]), source)
    table = _named(lambda: arm_timetable(found, commands), source)
    u, y = joined(list(arm_rows(table, [state])))
    header = arm_header(table, source)
    followed: FloatArray | None = None
    odd: tuple[DataWarning, ...] = ()
    if reference is not None and len(reference):
        log_times_ns = state.log_times_ns[table.run.messages][table.grid.kept]
        followed, odd = _references(reference, table, log_times_ns)
    data = header.record(
        u[:, :1], y, compensation=u[:, 1:], reference=followed, notices=(*header.notices, *odd)
    )
    data = replace(data, closed_loop=loop_kind(declared, data.head))
    in_force = found.command_sequence
    return BagReading(
        data,
        len(state),
        table.grid.lost,
        _duration_s(found.stamps_ns),
        unanswered=int(np.sum((np.diff(found.sequence) == 1) & (np.diff(in_force) < 1))),
    )


def io_timetable(found: Marks) -> Timetable:
    """Return the timetable of ``IoSample`` messages: inputs act from their own sample on."""
    return timetable(found, input_behind=False)


def io_rows(
    table: Timetable, pieces: Iterable[Recorded]
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Return u and y from ``IoSample``; rows of the grid."""
    columns = ((piece.real("inputs"), piece.real("outputs")) for piece in pieces)
    return record_rows(table, columns)


def io_header(
    table: Timetable, channels: Channels | None, widths: tuple[int, int], source: str
) -> Header:
    """Return what is known of a record of any rig.

    Parameters
    ----------
    table
        Its timetable.
    channels
        Names and rate; None when they were not recorded.
    widths
        Number of inputs and of outputs.
    source
        Name of the record.

    Returns
    -------
    Header
        With the declared rate, where it is that of the stamps.
    """
    dt_s, notices = table.grid.period_s, list(table.notices)
    if channels is None:
        text = "no ChannelInfo was recorded: names and kind of loop are unknown"
        notices.append(DataWarning("unknown_channels", text, {}))
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
            notices.append(DataWarning("other_rate", text, figures))
        else:
            dt_s = 1 / channels.rate_hz
    label = f"{source} ({channels.source})" if channels.source else source
    return Header(
        channels.inputs, channels.outputs, dt_s, channels.closed_loop, label, tuple(notices)
    )


def io_reading(samples: Recorded, channels: Channels | None, *, source: str) -> BagReading:
    """Return the record of any rig; its inputs act from their own sample on.

    Parameters
    ----------
    samples
        ``IoSample`` messages in the order in which they were sent; NaN in an output is not
        measured.
    channels
        Names and rate; None when they were not recorded.
    source
        Name of the record.

    Returns
    -------
    BagReading
        Without compensation and reference.

    Raises
    ------
    DataError
        If fewer than two samples follow each other, the arrays do not fit the names, or a value is
        not finite.
    """
    found = _named(lambda: marks([samples]), source)
    table = _named(lambda: io_timetable(found), source)
    u, y = joined(list(io_rows(table, [samples])))
    header = io_header(table, channels, (u.shape[1], y.shape[1]), source)
    return BagReading(
        header.record(u, y), len(samples), table.grid.lost, _duration_s(found.stamps_ns)
    )


def _named(work: Callable[[], _Result], source: str) -> _Result:
    """Do work whose errors do not name the record."""
    try:
        return work()
    except DataError as error:
        raise DataError(f"{source}: {error}") from error


def _duration_s(stamps_ns: NDArray[np.int64]) -> float:
    return float(stamps_ns[-1] - stamps_ns[0]) / _NS


def _references(
    reference: Recorded, table: Timetable, log_times_ns: NDArray[np.int64]
) -> tuple[FloatArray, tuple[DataWarning, ...]]:
    """Return the last reference sent before the sample that follows, per row."""
    start_ns = log_times_ns[0]
    next_ns = np.interp(np.arange(1, table.rows + 1), table.grid.instants, log_times_ns - start_ns)
    order = np.argsort(reference.log_times_ns, kind="stable")
    sent_ns = (reference.log_times_ns[order] - start_ns).astype(np.float64)
    latest = np.searchsorted(sent_ns, next_ns, side="left") - 1
    unknown = int(np.count_nonzero(latest < 0))
    values = reference.real("data")[order][np.maximum(latest, 0)]
    if unknown:
        text = f"no reference before row {unknown}: took the first one for the rows before"
        return values, (DataWarning("late_reference", text, {"rows": float(unknown)}),)
    return values, ()
