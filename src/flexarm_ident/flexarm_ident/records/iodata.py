"""Record of an experiment: inputs, outputs and their facts."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from flexarm_core.arrays import real_array
from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.clock import SAME_PERIOD
from flexarm_core.errors import DataError
from flexarm_core.labels import axis_label, counted, named_twice, time_unit_s, without_dots
from flexarm_core.showing.tables import html_table
from flexarm_core.showing.traces import Panel, plot_traces
from flexarm_ident.records.holes import filled, unusable_rows

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.records.data_warning import DataWarning

ARM_OUTPUTS = CHANNEL_NAMES
TIME_S = "time_s"
"""Column of the time in what `to_columns` returns."""
_EVEN = 0.01
_OF_DATES = "mM"


@dataclass(frozen=True, eq=False, repr=False)
class IoData:
    """Sampled inputs and outputs of one experiment (2-6), checked and read-only.

    Input ``u[k]`` acts between ``y[k]`` and ``y[k + 1]``: a controller's answer to sample `k`
    stands in row `k`.

    An output that was not measured in a row is missing there: NaN in the given array. The
    attribute `y` is filled in, `missing` marks these places, and `y_measured` has the NaN. Inputs
    must be known in all rows; in a hole, the command before it is held.

    Parameters
    ----------
    u, y : array_like, (samples, channels)
        Inputs and outputs. One-dimensional arrays are taken as one channel. NaN in `y` is missing.
    dt_s : float
        Sampling period.
    inputs, outputs : sequence of str
        Channel names, each once; a dot in one becomes an underscore.
    closed_loop : bool, optional
        True when a controller made the input. None when unknown.
    source : str
        Origin of the record, for messages and reports.
    compensation : array_like, (samples, inputs), optional
        The part of `u` that compensated Coulomb friction (section 2.4.3). None: no such part.
    reference : array_like, (samples,) or (samples, tracked), optional
        Set-points, in the units of the outputs; one-dimensional where there is one.
    tracked : sequence of str
        Outputs that the set-points are for; none given: the first output.
    notices : tuple of DataWarning
        Known defects of the recording, such as lost samples. An identification repeats them.
    missing : array_like of bool, (samples, outputs), optional
        Outputs that were not measured, beside those that are NaN. None: all were.
    input_held : array_like of bool, (samples,), optional
        Rows whose input was not recorded: that of the row before is held. None: all were.
    begins_s : float
        Instant of the first row in the record that this one is a part of, as `rows` gives it.
    head_of : int, optional
        Number of samples of the record that this one is the leading part of, as `head` gives it.
        None: it is a record of its own.
    part_of : str
        Label of the record between whose holes this one is a part, as `known_parts` gives it. Empty
        for a whole record.

    Raises
    ------
    DataError
        If shapes, names or the period do not fit, a value is not finite, or an output was never
        measured.
    """

    u: FloatArray
    y: FloatArray
    _: KW_ONLY
    dt_s: float
    inputs: tuple[str, ...] = ("command_v",)
    outputs: tuple[str, ...] = ARM_OUTPUTS
    closed_loop: bool | None = None
    source: str = ""
    compensation: FloatArray | None = None
    reference: FloatArray | None = None
    tracked: tuple[str, ...] = ()
    notices: tuple[DataWarning, ...] = ()
    missing: BoolArray | None = None
    input_held: BoolArray | None = None
    begins_s: float = 0.0
    head_of: int | None = None
    part_of: str = ""

    def __post_init__(self) -> None:
        self._set("inputs", without_dots(self.inputs))
        self._set("outputs", without_dots(self.outputs))
        self._set("tracked", without_dots(self.tracked))
        self._set("dt_s", float(self.dt_s))
        if not (math.isfinite(self.dt_s) and self.dt_s > 0.0):
            raise DataError(f"{self.label}: dt_s must be a positive number of seconds: {self.dt_s}")
        self._set("u", self._checked(self.u, "u", self.inputs))
        self._set("y", self._finite(self._filled(), self.outputs))
        if len(self.u) != len(self.y):
            raise DataError(f"{self.label}: u has {len(self.u)} samples, y has {len(self.y)}")
        if self.compensation is not None:
            names = tuple(f"compensation of {name}" for name in self.inputs)
            self._set("compensation", self._checked(self.compensation, "compensation", names))
        if self.reference is not None:
            names = tuple(f"set-point of {name}" for name in self._tracked)
            reference = self._checked(self.reference, "reference", names)
            self._set("reference", reference[:, 0] if len(names) == 1 else reference)
        for name in ("compensation", "reference", "input_held"):
            column = getattr(self, name)
            if column is not None and len(column) != len(self.u):
                raise DataError(
                    f"{self.label}: {name} has {len(column)} samples, u has {len(self.u)}"
                )

    def __len__(self) -> int:
        return len(self.u)

    def __repr__(self) -> str:
        channels = f"{', '.join(self.inputs)} -> {', '.join(self.outputs)}"
        return f"<{type(self).__name__} {self._size}; {channels}>"

    def _repr_html_(self) -> str:
        columns = (*zip(self.inputs, self.u.T, strict=True), *self._measured)
        rows = [
            (name, *(f"{figure(values):.4g}" for figure in (np.nanmin, np.nanmax, np.nanstd)))
            for name, values in columns
        ]
        return html_table(self._size, ("channel", "least", "greatest", "deviation"), rows)

    def plot_signals(self) -> NDArray[np.object_]:
        """Plot inputs and outputs over time; a trace breaks off where nothing was measured.

        Returns
        -------
        ndarray of matplotlib.axes.Axes, (inputs + outputs,)
            The axes.
        """
        columns = (*zip(self.inputs, self.u.T, strict=True), *self._measured)
        panels = [Panel(axis_label(name), [("", values)]) for name, values in columns]
        return plot_traces(self.times_s, panels)

    @property
    def _measured(self) -> list[tuple[str, FloatArray]]:
        return list(zip(self.outputs, self.y_measured.T, strict=True))

    @property
    def _tracked(self) -> tuple[str, ...]:
        return self.tracked or self.outputs[:1]

    @property
    def _size(self) -> str:
        span = f"{counted(len(self), 'sample')} at {1.0 / self.dt_s:.6g} Hz"
        return f"{self.label}: {span}, {len(self) * self.dt_s:.4g} s"

    @property
    def label(self) -> str:
        """Name of the record in messages."""
        return self.source or "record"

    @property
    def whole_samples(self) -> int:
        """Number of samples of the record that this is the leading part of, or its own number."""
        return len(self) if self.head_of is None else self.head_of

    @property
    def times_s(self) -> FloatArray:
        """Instants of the samples from the first one on, (samples,)."""
        return np.linspace(0.0, (len(self) - 1) * self.dt_s, len(self))

    @property
    def effort(self) -> FloatArray:
        """Input without the Coulomb compensation (section 2.4.3), (samples, inputs)."""
        return self.u if self.compensation is None else self.u - self.compensation

    def of_tracked(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return those values, (outputs,), that belong to the set-points, (tracked,)."""
        return values[[self.outputs.index(name) for name in self._tracked]]

    @cached_property
    def usable(self) -> BoolArray:
        """Rows that are measured, or filled where a short hole was, (samples,)."""
        if self.missing is None:
            return np.ones(len(self), dtype=np.bool_)
        return ~unusable_rows(self.missing)

    @property
    def y_measured(self) -> FloatArray:
        """Outputs with NaN where they were not measured, (samples, outputs)."""
        return self.y if self.missing is None else np.where(self.missing, np.nan, self.y)

    @property
    def y_usable(self) -> FloatArray:
        """Outputs with NaN in the rows that are not `usable`, (samples, outputs)."""
        if self.missing is None:
            return self.y
        return np.where(self.usable[:, np.newaxis], self.y, np.nan)

    def chunks(self, samples: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Return u and `y_usable` from the start, `samples` rows each, the last with the rest."""
        y = self.y_usable
        for first in range(0, len(self), samples):
            yield self.u[first : first + samples], y[first : first + samples]

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples (all of them if there are fewer)."""
        return replace(self.rows(slice(0, samples)), head_of=self.whole_samples)

    def split(self, fraction: float) -> tuple[IoData, IoData]:
        """Return the leading `fraction` of the record and the rest; DataError when one is empty."""
        samples = round(fraction * len(self)) if math.isfinite(fraction) else 0
        if not 0 < samples < len(self):
            raise DataError(f"{self.label}: fraction must lie between 0 and 1: {fraction}")
        return self.rows(slice(0, samples)), self.rows(slice(samples, None))

    def rows(self, rows: slice) -> IoData:
        """Return some rows of the record."""
        return replace(
            self,
            u=self.u[rows],
            y=self.y[rows],
            compensation=None if self.compensation is None else self.compensation[rows],
            reference=None if self.reference is None else self.reference[rows],
            missing=None if self.missing is None else self.missing[rows],
            input_held=None if self.input_held is None else self.input_held[rows],
            begins_s=self.begins_s + (rows.start or 0) * self.dt_s,
            head_of=None,
        )

    def _filled(self) -> FloatArray:
        """Return the outputs with missing samples filled in, and store the places of these."""
        y = self._shaped(self.y, "y", self.outputs)
        unknown = np.isnan(y)
        missing = unknown
        if self.missing is not None:
            missing = np.asarray(self.missing, dtype=np.bool_)
            if missing.shape != y.shape:
                raise DataError(f"{self.label}: missing must be {y.shape} as y: {missing.shape}")
            missing = missing | unknown
        self._set("missing", missing if missing.any() else None)
        if not missing.any():
            return y
        never = np.flatnonzero(missing.all(axis=0))
        if len(never):
            name = self.outputs[never[0]]
            raise DataError(f"{self.label}: {name} was never measured: leave it out")
        missing.setflags(write=False)
        return filled(y, missing) if unknown.any() else y

    def _set(self, field: str, value: object) -> None:
        object.__setattr__(self, field, value)

    def _checked(self, values: ArrayLike, field: str, names: Sequence[str]) -> FloatArray:
        return self._finite(self._shaped(values, field, names), names)

    def _shaped(self, values: ArrayLike, field: str, names: Sequence[str]) -> FloatArray:
        try:
            array = real_array(values)
        except (TypeError, ValueError):
            raise DataError(f"{self.label}: {field} must be an array of real numbers") from None
        if array.ndim == 1:
            array = array[:, np.newaxis]
        if array.ndim != 2 or (array.size == 0 and (names or not len(array))):  # noqa: PLR2004 (samples, channels)
            raise DataError(f"{self.label}: {field} must be (samples, channels): {array.shape}")
        if array.shape[1] != len(names):
            turned = " (transposed?)" if array.shape[0] == len(names) < array.shape[1] else ""
            found = f"{self.label}: {field} has {counted(array.shape[1], 'channel')}{turned}"
            raise DataError(f"{found}, but {counted(len(names), 'name')}: {', '.join(names)}")
        if twice := named_twice(names):
            raise DataError(
                f"{self.label}: {twice} in {field}: give each channel a name of its own"
            )
        return array

    def _finite(self, array: FloatArray, names: Sequence[str]) -> FloatArray:
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            row, channel = bad[0]
            raise DataError(
                f"{self.label}: {names[channel]} is {array[row, channel]} in row {row}: "
                "remove or repair the samples that are not finite"
            )
        array.setflags(write=False)
        return array


def as_records(data: IoData | Sequence[IoData]) -> tuple[IoData, ...]:
    """Return one or several records as a tuple, checked to be of the same rig.

    Raises
    ------
    DataError
        If there is no record, or the channels or periods differ.
    """
    records = (data,) if isinstance(data, IoData) else tuple(data)
    if not records:
        raise DataError("no record given")
    first = records[0]
    for record in records[1:]:
        for field in ("inputs", "outputs"):
            if getattr(record, field) != getattr(first, field):
                names = [", ".join(getattr(each, field)) for each in (record, first)]
                raise DataError(
                    f"{record.label}: {field} {names[0]} differ from {names[1]} of {first.label}"
                )
        if not math.isclose(record.dt_s, first.dt_s, rel_tol=SAME_PERIOD):
            raise DataError(
                f"{record.label}: dt_s {record.dt_s} differs from {first.dt_s} of {first.label}"
            )
    return records


class Columns(Protocol):
    """What is asked of a table: its columns, by their names."""

    def __getitem__(self, name: str, /) -> Any:  # noqa: ANN401 - an array or a series
        """Return a column."""

    def keys(self) -> Iterable[Any]:
        """Return the names of the columns."""


def to_columns(record: IoData) -> dict[str, FloatArray]:
    """Return a record as columns, for `pandas.DataFrame` and the like.

    Parameters
    ----------
    record : IoData
        Record of `n` samples.

    Returns
    -------
    dict of str to ndarray, (n,)
        ``time_s`` from 0, then inputs and outputs by their names. Missing values are NaN.
    """
    return {
        TIME_S: record.dt_s * np.arange(len(record)),
        **dict(zip(record.inputs, record.u.T, strict=True)),
        **dict(zip(record.outputs, record.y_measured.T, strict=True)),
    }


def from_columns(
    table: Columns,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    time: str = TIME_S,
    source: str = "",
) -> IoData:
    """Return the record that a table of columns holds.

    Parameters
    ----------
    table : pandas.DataFrame or mapping of str to array_like
        Columns of `n` rows; those that are not named stay behind.
    inputs, outputs : sequence of str
        Names of the columns of inputs and outputs. NaN in an output is a missing value.
    time : str
        Name of the column of the time, in s or the unit at the end of the name (``time_ms``), or of
        dates or time differences. It rises by equal steps.
    source : str
        Origin of the record, for messages and reports.

    Returns
    -------
    IoData
        Record of `n` samples.

    Raises
    ------
    DataError
        If a column is not there, has no numbers or has another length than the time, or a step of
        the time differs by more than 1 % from the mean step.
    """
    time_s = _times_s(table, time)
    steps_s = np.diff(time_s)
    dt_s = float(np.mean(steps_s)) if len(steps_s) else 0.0
    uneven = np.flatnonzero(~(np.abs(steps_s - dt_s) <= _EVEN * dt_s))
    if len(uneven) or dt_s <= 0.0:
        row = int(uneven[0]) + 1 if len(uneven) else len(time_s)
        raise DataError(
            f"column {time}: the time must rise by equal steps, and does not at row {row} "
            "(from 0): resample the table, or cut it there"
        )
    columns = {name: _column(table, name) for name in (*inputs, *outputs)}
    for name, column in columns.items():
        if len(column) != len(time_s):
            raise DataError(f"column {name} has {len(column)} rows, {time} has {len(time_s)}")
    return IoData(
        np.column_stack([columns[name] for name in inputs]),
        np.column_stack([columns[name] for name in outputs]),
        dt_s=dt_s,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        source=source,
    )


def _times_s(table: Columns, name: str) -> FloatArray:
    """Return the times of a column, s: of dates and time differences those since the first."""
    column = np.asarray(table[_known(table, name)])
    if column.dtype.kind not in _OF_DATES:
        return _column(table, name) * (time_unit_s(name) or 1.0)
    return np.asarray((column - column[:1]) / np.timedelta64(1, "s"), dtype=np.float64)


def _column(table: Columns, name: str) -> FloatArray:
    try:
        return real_array(table[_known(table, name)])
    except (TypeError, ValueError):
        raise DataError(f"column {name} holds something else than numbers") from None


def _known(table: Columns, name: str) -> str:
    names = [str(each) for each in table.keys()]  # noqa: SIM118 - a frame has no other iterator
    if name not in names:
        raise DataError(f"no column {name}; there are: {', '.join(names)}")
    return name
