"""From recorded columns to an experiment's record: which input acts on which sample, and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.data_warning import DataWarning
from flexarm_ident.errors import DataError
from flexarm_ident.iodata import ARM_OUTPUTS, IoData
from flexarm_ident.sampling import longest_run, lost_samples, sampling_period_s

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.cdr import Column

# A declared rate further off than this from the stamps is worth a warning.
RATE_TOLERANCE = 1e-2
_NS = 1_000_000_000


@dataclass(frozen=True)
class Recorded:
    """The messages of one topic as columns.

    Attributes
    ----------
    log_times_ns : (messages,)
        When each was sent.
    columns
        Member name -> values, first axis messages.
    """

    log_times_ns: NDArray[np.int64]
    columns: Mapping[str, Column]

    def __len__(self) -> int:
        return len(self.log_times_ns)

    def real(self, name: str) -> FloatArray:
        """Return a column as floating point.

        Raises
        ------
        DataError
            If the recorded message type has no such member.
        """
        return np.asarray(self._column(name), dtype=np.float64)

    def integer(self, name: str) -> NDArray[np.int64]:
        """Return a column as integers.

        Raises
        ------
        DataError
            If the recorded message type has no such member.
        """
        return np.asarray(self._column(name)).astype(np.int64)

    def stamps_ns(self) -> NDArray[np.int64]:
        """Return the instants in the headers."""
        return self.integer("header.stamp.sec") * _NS + self.integer("header.stamp.nanosec")

    def _column(self, name: str) -> Column:
        if name not in self.columns:
            raise DataError(f"the recorded messages have no member {name}")
        return self.columns[name]


@dataclass(frozen=True)
class Channels:
    """What the arrays of IoSample mean, from ChannelInfo."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rate_hz: float
    closed_loop: bool
    source: str


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
        Samples missing by their sequence numbers.
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


def arm_reading(
    state: Recorded, reference: Recorded | None, *, commanded: bool, source: str
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
    commanded
        True when commands were recorded.
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
    _require(state, source)
    sequence = state.integer("sequence")
    run = longest_run(sequence)
    notices = list(lost_samples(run, len(state)))
    rows = range(len(state))[run.rows]
    if len(rows) < 3:  # noqa: PLR2004 - two rows of data and the message behind them
        raise DataError(f"{source}: only {len(rows)} samples follow each other; record again")
    stamps_ns = state.stamps_ns()
    dt_s, odd = sampling_period_s(stamps_ns[run.rows])
    notices += odd
    now, behind = slice(rows[0], rows[-1]), slice(rows[1], rows[-1] + 1)
    followed = None
    if reference is not None and len(reference):
        followed, odd = _references(reference, state.log_times_ns[behind])
        notices += odd
    in_force = state.integer("command_sequence")
    answered = commanded or followed is not None or bool(np.any(in_force))
    data = IoData(
        state.real("command_v")[behind],
        np.column_stack([state.real(name)[now] for name in ARM_OUTPUTS]),
        dt_s=dt_s,
        inputs=("command_v",),
        outputs=ARM_OUTPUTS,
        closed_loop=True if answered else None,
        source=source,
        compensation=state.real("compensation_v")[behind],
        reference=followed,
        notices=tuple(notices),
    )
    return BagReading(
        data,
        len(state),
        run.lost,
        _duration_s(stamps_ns),
        unanswered=int(np.sum((np.diff(sequence) == 1) & (np.diff(in_force) < 1))),
    )


def io_reading(samples: Recorded, channels: Channels | None, *, source: str) -> BagReading:
    """Return the record of any rig; its inputs act from their own sample on.

    Parameters
    ----------
    samples
        ``IoSample`` messages in the order in which they were sent.
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
    _require(samples, source)
    run = longest_run(samples.integer("sequence"))
    notices = list(lost_samples(run, len(samples)))
    if run.rows.stop - run.rows.start < 2:  # noqa: PLR2004 - a period needs two samples
        raise DataError(f"{source}: no two samples follow each other; record again")
    stamps_ns = samples.stamps_ns()
    dt_s, odd = sampling_period_s(stamps_ns[run.rows])
    notices += odd
    u, y = samples.real("inputs")[run.rows], samples.real("outputs")[run.rows]
    if channels is None:
        channels = Channels(
            tuple(f"input_{index + 1}" for index in range(u.shape[1])),
            tuple(f"output_{index + 1}" for index in range(y.shape[1])),
            rate_hz=1 / dt_s,
            closed_loop=False,
            source="",
        )
        closed_loop = None
        text = "no ChannelInfo was recorded: names and kind of loop are unknown"
        notices.append(DataWarning("unknown_channels", text, {}))
    else:
        closed_loop = channels.closed_loop
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
    data = IoData(
        u,
        y,
        dt_s=dt_s,
        inputs=channels.inputs,
        outputs=channels.outputs,
        closed_loop=closed_loop,
        source=f"{source} ({channels.source})" if channels.source else source,
        notices=tuple(notices),
    )
    return BagReading(data, len(samples), run.lost, _duration_s(stamps_ns))


def _require(recorded: Recorded, source: str) -> None:
    if len(recorded) == 0:
        raise DataError(f"{source}: no messages on the topic")


def _duration_s(stamps_ns: NDArray[np.int64]) -> float:
    return float(stamps_ns[-1] - stamps_ns[0]) / _NS


def _references(
    reference: Recorded, next_times_ns: NDArray[np.int64]
) -> tuple[FloatArray, tuple[DataWarning, ...]]:
    """Return the last reference sent before the sample that follows, per row."""
    order = np.argsort(reference.log_times_ns, kind="stable")
    latest = np.searchsorted(reference.log_times_ns[order], next_times_ns, side="left") - 1
    unknown = int(np.count_nonzero(latest < 0))
    values = reference.real("data")[order][np.maximum(latest, 0)]
    if unknown:
        text = f"no reference before row {unknown}: took the first one for the rows before"
        return values, (DataWarning("late_reference", text, {"rows": float(unknown)}),)
    return values, ()
