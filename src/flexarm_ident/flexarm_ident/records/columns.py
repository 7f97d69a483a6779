"""Record from named columns and back, as a pandas data frame or a dictionary of arrays has them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from flexarm_core.arrays import real_array
from flexarm_core.errors import DataError
from flexarm_core.labels import time_unit_s
from flexarm_ident.records.iodata import IoData

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flexarm_core.arrays import FloatArray

TIME_S = "time_s"
"""Column of the time in what `to_columns` returns."""
_EVEN = 0.01
_OF_DATES = "mM"


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
