"""Record of a table of text: its columns on the even grid that their times tell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.reader import Channels, Recorded
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import named_columns, other_clocks, unused_time, with_units
from flexarm_ident.importing.csv_map import FASTEST_HZ, SLOWEST_HZ, CsvMap, is_rate, unit_notes
from flexarm_ident.importing.csv_resampling import on_one_grid, resampled
from flexarm_ident.importing.csv_table import read_table, table_layout
from flexarm_ident.importing.csv_times import Sampling, sampling, unit_question
from flexarm_ident.reading.alignment import io_alignment
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
_NS = 1_000_000_000


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
        return np.array([round(k * _NS / rate_hz) for k in self.sampling.places.tolist()], np.int64)


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
            "header.stamp.sec": stamps_ns // _NS,
            "header.stamp.nanosec": stamps_ns % _NS,
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
