"""Record of a table of text: its columns on the even grid that their times tell.

Rows at uneven times are resampled where a map gives a rate beside their times. The input of a row
acts until the next row, so an even row has the mean of what acted until the even row after it.
The outputs are interpolated by Akima's piecewise polynomials, which do not overshoot where samples
are close together.

Akima, "A new method of interpolation and smooth curve fitting based on local procedures", Journal
of the ACM 17 (1970).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.reader import Channels, Recorded
from flexarm_core.clock import NS
from flexarm_core.errors import DataError
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import named_columns, other_clocks, unused_time, with_units
from flexarm_ident.importing.csv_map import FASTEST_HZ, SLOWEST_HZ, CsvMap, is_rate, unit_notes
from flexarm_ident.importing.csv_table import read_table, table_layout
from flexarm_ident.importing.csv_times import Sampling, refuse_backwards, sampling, unit_question
from flexarm_ident.reading.alignment import io_alignment
from flexarm_ident.reading.offsets import on_their_rows
from flexarm_ident.reading.tracks import evened, track
from flexarm_ident.records.data_warning import TABLE

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.importing.csv_columns import TableColumns
    from flexarm_ident.importing.csv_table import CsvTable
    from flexarm_ident.records.iodata import IoData

# Seconds of a stamp are an int32.
_LATEST_S = 2**31 - 1
# Rate in units of that of the rows: with less, noise and vibration fold down, and with more the
# interpolation makes up what was not measured.
_LOWEST, _HIGHEST = 0.8, 1.25
# Steps, in usual ones, beyond which a row between two samples is missing, and how near to either of
# them it is not.
_HOLE, _NEAR = 2.5, 0.5
_FEWEST = 3


@dataclass(frozen=True, eq=False)
class CsvRecord:
    """Signals of a CSV file as they stand there.

    Attributes
    ----------
    mapping : CsvMap
        Its columns, with the units that the file gives.
    inputs, outputs : ndarray, (rows, channels)
        Signals in the order of the map; NaN in an output that was not measured.
    sampling : Sampling
        Rate and places of the rows.
    notes : tuple of str
        Lines at the ends that are left out, with the reason, and doubts about units and the time.
    """

    mapping: CsvMap
    inputs: FloatArray
    outputs: FloatArray
    sampling: Sampling
    notes: tuple[str, ...]

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Instants of the rows from the first one on, (rows,)."""
        rate_hz = self.sampling.rate_hz
        return np.array([round(k * NS / rate_hz) for k in self.sampling.places.tolist()], np.int64)


def read_csv(path: Path, columns: CsvMap | TableColumns, *, wrap: float | None = None) -> IoData:
    """Read columns of a table of text as the record of an experiment.

    Rows that are missing, and outputs that were not measured, are holes, as in a bag.

    Parameters
    ----------
    path : Path
        File.
    columns : CsvMap or TableColumns
        Its inputs, outputs and time.
    wrap : float, optional
        As in `reading.read.read_bag`.

    Raises
    ------
    CsvImportError
        As `csv_record` does.
    """
    mapping = columns if isinstance(columns, CsvMap) else named_columns(path, columns)
    table = csv_record(path, mapping)
    stamps_ns = table.stamps_ns
    samples = Recorded(
        stamps_ns,
        {
            "header.stamp.sec": stamps_ns // NS,
            "header.stamp.nanosec": stamps_ns % NS,
            "sequence": table.sampling.places + 1,
            "inputs": table.inputs,
            "outputs": table.outputs,
        },
    )
    channels = Channels(
        tuple(each.name for each in mapping.inputs),
        tuple(each.name for each in mapping.outputs),
        table.sampling.rate_hz,
        mapping.closed_loop,
        "",
    )
    aligned = io_alignment(lambda: [samples], channels, source=str(path), wrap=wrap)
    data = aligned.reading(samples).data
    # A map says whether the outputs made the inputs.
    loop = data.closed_loop if mapping is columns else None
    return replace(data, closed_loop=loop, notices=(*data.notices, *map(TABLE, table.notes)))


def csv_record(path: Path, mapping: CsvMap) -> CsvRecord:
    """Read the mapped columns of a file.

    Raises
    ------
    CsvImportError
        If the file cannot be read, lacks a column, has fewer than 2 rows, a cell that is not a
        finite number (outputs may lack some), irregular or drifting time steps, or times that
        stamps cannot show. The message names file, line and column.
    BoundError
        If it is not a plain file.
    """
    layout = table_layout(path)
    mapping = with_units(mapping, layout)
    table = read_table(path, mapping, layout)
    inputs, outputs, found = _signals(table, mapping)
    notes = (*table.cut, *unit_notes(mapping), *unused_time(path, mapping, layout))
    notes += other_clocks(path, mapping, layout)
    if table.own_instants:
        notes += (f"each column has its own rows: put on one grid of {found.rate_hz:g} Hz",)
    elif mapping.resamples:
        notes += (f"{len(table.lines)} rows were resampled to {mapping.rate_hz:g} Hz",)
    if mapping.time is not None:
        names = [
            text
            for each in (*mapping.inputs, *mapping.outputs)
            for text in (each.column, each.name, each.unit)
        ]
        notes += unit_question(table, mapping.time, names, found.rate_hz)
    return CsvRecord(mapping, inputs, outputs, found, notes)


def _signals(table: CsvTable, mapping: CsvMap) -> tuple[FloatArray, FloatArray, Sampling]:
    signals = table.values
    if table.own_instants:
        return on_one_grid(table, mapping)
    if mapping.time is not None and mapping.rate_hz is not None:
        found, signals = resampled(table, mapping.time, len(mapping.inputs), mapping.rate_hz)
    elif mapping.time is not None:
        found, signals = sampling(table, mapping.time), signals[:, 1:]
    elif mapping.rate_hz is not None:
        found = Sampling(mapping.rate_hz, table.places)
    else:
        raise CsvImportError(f"{table.path}: the map names neither a time column nor rate_hz")
    _require_stamps(table.path, found)
    width = len(mapping.inputs)
    return signals[:, :width], signals[:, width:], found


def _require_stamps(path: Path, found: Sampling) -> None:
    rate_hz, rows = found.rate_hz, found.places[-1] + 1
    if not is_rate(rate_hz):
        raise CsvImportError(
            f"{path}: a rate of {rate_hz:.6g} Hz is outside {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz: "
            "times are in seconds, or in a unit at the end of the column's name, as in time_us; "
            "else state it: --time COLUMN:us (ms, ns, min, h, or d for a spreadsheet's days)"
        )
    if (rows - 1) / rate_hz > _LATEST_S:
        raise CsvImportError(
            f"{path}: {rows} rows at {rate_hz:.6g} Hz last longer than {_LATEST_S} s, which stamps "
            "cannot show: cut the file"
        )


def resampled(
    table: CsvTable, column: str, inputs: int, rate_hz: float
) -> tuple[Sampling, FloatArray]:
    """Return the sampling of even rows and their signals, (rows, channels), NaN in holes.

    Parameters
    ----------
    table : CsvTable
        Times, inputs and outputs.
    column : str
        Name of the column of the time.
    inputs : int
        Number of inputs.
    rate_hz : float
        Even rate, Hz.

    Raises
    ------
    CsvImportError
        If the times do not rise, there are fewer than 3 rows, the rate differs by more than a
        quarter from that of the rows, or most even rows are missing.
    """
    times_s = table.values[:, 0]
    steps_s = np.diff(times_s)
    if len(times_s) < _FEWEST:
        raise CsvImportError(f"{table.path}: {len(times_s)} rows are too few to resample")
    refuse_backwards(table, column, steps_s)
    usual_s = float(np.median(steps_s))
    if not _LOWEST <= rate_hz * usual_s <= _HIGHEST:
        raise CsvImportError(
            f"{table.path}: rate_hz {rate_hz:g} is far from that of the rows, {1.0 / usual_s:.4g} "
            f"Hz: choose {_LOWEST / usual_s:.4g} to {_HIGHEST / usual_s:.4g} Hz"
        )
    even_s = times_s[0] + np.arange(int((times_s[-1] - times_s[0]) * rate_hz) + 1) / rate_hz
    u, y = table.values[:, 1 : 1 + inputs], table.values[:, 1 + inputs :]
    outputs = np.column_stack([_interpolated(times_s, each, even_s, usual_s) for each in y.T])
    places = np.flatnonzero(np.isfinite(outputs).any(axis=1))
    if 2 * len(places) < len(even_s):
        raise CsvImportError(
            f"{table.path}: {len(even_s) - len(places)} of {len(even_s)} rows at {rate_hz:g} Hz "
            "have no sample near them: make a file of each part, and give them together"
        )
    signals = np.hstack([_mean_held(times_s, u, even_s, 1.0 / rate_hz), outputs])[places]
    return Sampling(rate_hz, places - places[0]), signals


def on_one_grid(table: CsvTable, mapping: CsvMap) -> tuple[FloatArray, FloatArray, Sampling]:
    """Return inputs and outputs of columns that have rows of their own, as topics of a bag have.

    Raises
    ------
    CsvImportError
        If the columns do not overlap in time, or their times do not advance.
    """
    times_ns = np.rint((table.values[:, 0] - table.values[0, 0]) * NS).astype(np.int64)
    names = [each.column for each in (*mapping.inputs, *mapping.outputs)]
    try:
        signals = [
            evened(track(name, times_ns, values))
            for name, values in zip(names, table.values[:, 1:].T, strict=True)
        ]
        width = len(mapping.inputs)
        found, _ = on_their_rows(signals[:width], signals[width:])
    except DataError as error:
        raise CsvImportError(f"{table.path}: {error}") from error
    return found.u, found.y, Sampling(1.0 / found.grid.period_s, np.arange(len(found.rows)))


def _mean_held(
    times_s: FloatArray, u: FloatArray, even_s: FloatArray, period_s: float
) -> FloatArray:
    """Return the means over the even periods of inputs that each row holds until the next."""
    ends_s = np.append(times_s, max(times_s[-1], even_s[-1]) + period_s)
    sums = np.vstack([np.zeros(u.shape[1]), np.cumsum(u * np.diff(ends_s)[:, np.newaxis], axis=0)])
    edges_s = np.append(even_s, even_s[-1] + period_s)
    return np.column_stack(
        [np.diff(np.interp(edges_s, ends_s, each)) / period_s for each in sums.T]
    )


def _interpolated(
    times_s: FloatArray, y: FloatArray, even_s: FloatArray, usual_s: float
) -> FloatArray:
    """Return an output at even times; NaN in holes and where it was not measured."""
    # It takes long to import.
    from scipy.interpolate import Akima1DInterpolator  # noqa: PLC0415

    known = np.isfinite(y)
    if np.count_nonzero(known) < _FEWEST:
        return np.full(len(even_s), np.nan)
    at_s = times_s[known]
    values = np.asarray(Akima1DInterpolator(at_s, y[known])(even_s))
    after = np.searchsorted(at_s, even_s).clip(1, len(at_s) - 1)
    before_s, after_s = at_s[after - 1], at_s[after]
    near = np.minimum(np.abs(even_s - before_s), np.abs(after_s - even_s)) <= _NEAR * usual_s
    in_hole = (after_s - before_s > _HOLE * usual_s) & ~near
    return np.where(in_hole, np.nan, values)
