"""Import of measurements from a CSV file into a bag, so that every later step reads bags only.

The first row has time 0, and each row stands whole sampling intervals later; where rows are missing
their numbers are too. An output that was not measured is NaN. Header stamp, log time and publish
time of a message are the instant of its row. The channel information is written once, at time 0,
before the first sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.records.columns import decode, members
from flexarm_bags.schema import describe
from flexarm_bags.writer import whole_bag
from flexarm_ident.importing.csv_columns import unused_time, with_units
from flexarm_ident.importing.csv_layout import CsvImportError
from flexarm_ident.importing.csv_map import FASTEST_HZ, SLOWEST_HZ, is_rate, unit_notes
from flexarm_ident.importing.csv_resampling import on_one_grid, resampled
from flexarm_ident.importing.csv_table import read_table, table_layout
from flexarm_ident.importing.csv_times import Sampling, sampling, unit_question

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from rosbags.typesys.store import Msg, Typestore

    from flexarm_bags.schema import MessageDefinition
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
    from flexarm_ident.importing.csv_table import CsvTable

IO_TOPIC = "/flexarm/io"
CHANNELS_TOPIC = "/flexarm/io_channels"
# Seconds of a stamp are an int32.
_LATEST_S = 2**31 - 1
_NS = 1_000_000_000
_BLOCK_ROWS = 50_000


@dataclass(frozen=True)
class ImportSummary:
    """Summary of an import.

    Attributes
    ----------
    bag : Path
        New rosbag2 folder.
    samples : int
        Rows imported.
    rate_hz, duration_s : float
        Sampling rate, Hz, and time from the first to the last sample, s.
    sha256 : str
        Hash of the CSV file, also in the bag's source.
    missing_rows, missing_cells : int
        Rows that the times leave out, and outputs that were not measured in a row.
    notes : tuple of str
        Lines at the ends that are left out, with the reason, and doubts about units and the time.
    """

    bag: Path
    samples: int
    rate_hz: float
    duration_s: float
    sha256: str
    missing_rows: int
    missing_cells: int
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class CsvRecord:
    """Signals of a CSV file.

    Attributes
    ----------
    inputs, outputs : ndarray, (rows, channels)
        Signals in the order of the map; NaN in an output that was not measured.
    sampling : Sampling
        Rate and places of the rows.
    """

    inputs: FloatArray
    outputs: FloatArray
    sampling: Sampling

    def even(self) -> tuple[FloatArray, FloatArray]:
        """Return inputs and outputs on even rows: missing ones hold the input, outputs are NaN."""
        places = self.sampling.places
        latest = np.searchsorted(places, np.arange(places[-1] + 1), side="right") - 1
        outputs = np.full((len(latest), self.outputs.shape[1]), np.nan)
        outputs[places] = self.outputs
        return self.inputs[latest], outputs


def import_csv(
    csv_path: Path,
    mapping: CsvMap,
    bag_path: Path,
    *,
    typestore: Typestore,
    folder_of: Callable[[str], Path | None] | None = None,
    judged: Callable[[CsvRecord], bool] | None = None,
    kept: bool = True,
) -> ImportSummary:
    """Write the mapped columns of a CSV file as ``IoSample`` messages into a new bag.

    Parameters
    ----------
    csv_path : Path
        Comma separated file with the column names in its first line, in the units of the map.
    mapping : CsvMap
        Columns and their names; see :func:`flexarm_ident.importing.csv_map.load_csv_map`.
    bag_path : Path
        Folder to create.
    typestore : Typestore
        Types with ``flexarm_msgs``; see :func:`flexarm_bags.schema.load_typestore`.
    folder_of : callable, optional
        Folders of the messages' files; see :func:`flexarm_bags.schema.describe`.
    judged : callable, optional
        Tells from the signals whether the loop was closed. None: the map says it.
    kept : bool
        The bag is for keeps, and says where it comes from.

    Returns
    -------
    ImportSummary
        Samples, rate, hash and holes.

    Raises
    ------
    CsvImportError
        If the file cannot be read, lacks a column, has fewer than 2 rows, a cell that is no finite
        number (outputs may lack some), irregular or drifting time steps, or times that stamps
        cannot show. The message names file, line and column.
    BoundError
        If it is no plain file.
    RecordingError
        If the bag exists or cannot be written.
    """
    layout = table_layout(csv_path)
    mapping = with_units(mapping, layout)
    table = read_table(csv_path, mapping, layout)
    record = _record(table, mapping)
    asked: tuple[str, ...] = ()
    if mapping.time is not None:
        names = [
            text
            for each in (*mapping.inputs, *mapping.outputs)
            for text in (each.column, each.name, each.unit)
        ]
        asked = unit_question(table, mapping.time, names, record.sampling.rate_hz)
    digest = _hash(csv_path)
    told = (mapping.description, f"{csv_path.name} sha256:{digest}") if kept else ()
    resampling = f"rows resampled to {mapping.rate_hz:g} Hz" if mapping.resamples else ""
    source = "; ".join(filter(None, (*told, resampling)))
    definitions = {
        name: describe(typestore, f"flexarm_msgs/msg/{name}", folder_of)
        for name in ("IoSample", "ChannelInfo")
    }
    closed_loop = judged(record) if judged else mapping.closed_loop
    mapping = replace(mapping, closed_loop=closed_loop)
    _write(bag_path, typestore, definitions, mapping, record, source=source)
    notes = (*table.cut, *unit_notes(mapping), *unused_time(csv_path, mapping, layout))
    if table.own_instants:
        notes += (
            f"each column has its own rows: put on one grid of {record.sampling.rate_hz:g} Hz",
        )
    elif mapping.resamples:
        notes += (f"{len(table.lines)} rows were resampled to {mapping.rate_hz:g} Hz",)
    notes += asked
    rows, last = len(record.inputs), int(record.sampling.places[-1])
    return ImportSummary(
        bag_path,
        rows,
        record.sampling.rate_hz,
        last / record.sampling.rate_hz,
        digest,
        missing_rows=last + 1 - rows,
        missing_cells=int(np.isnan(record.outputs).sum()),
        notes=notes,
    )


def _record(table: CsvTable, mapping: CsvMap) -> CsvRecord:
    signals = table.values
    if table.own_instants:
        return CsvRecord(*on_one_grid(table, mapping))
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
    return CsvRecord(signals[:, :width], signals[:, width:], found)


def _require_stamps(path: Path, found: Sampling) -> None:
    rate_hz, rows = found.rate_hz, found.places[-1] + 1
    if not is_rate(rate_hz):
        raise CsvImportError(
            f"{path}: a rate of {rate_hz:.6g} Hz is outside {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz: "
            "times are in seconds, or in a unit at the end of the column's name, as in time_us"
        )
    if (rows - 1) / rate_hz > _LATEST_S:
        raise CsvImportError(
            f"{path}: {rows} rows at {rate_hz:.6g} Hz last longer than {_LATEST_S} s, which stamps "
            "cannot show: cut the file"
        )


def _hash(path: Path) -> str:
    digest = sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _write(
    bag_path: Path,
    typestore: Typestore,
    definitions: Mapping[str, MessageDefinition],
    mapping: CsvMap,
    record: CsvRecord,
    *,
    source: str,
) -> None:
    info_type = typestore.types["flexarm_msgs/msg/ChannelInfo"]
    header_type = typestore.types["std_msgs/msg/Header"]
    time_type = typestore.types["builtin_interfaces/msg/Time"]

    def header(stamp_ns: int) -> Msg:
        stamp = time_type(sec=stamp_ns // _NS, nanosec=stamp_ns % _NS)
        return header_type(stamp=stamp, frame_id="")

    def names_and_units(channels: Sequence[CsvChannel]) -> tuple[list[str], list[str]]:
        return [channel.name for channel in channels], [channel.unit for channel in channels]

    input_names, input_units = names_and_units(mapping.inputs)
    output_names, output_units = names_and_units(mapping.outputs)
    info = info_type(
        header=header(0),
        sampling_rate_hz=record.sampling.rate_hz,
        input_names=input_names,
        input_units=input_units,
        output_names=output_names,
        output_units=output_units,
        source=source,
        closed_loop=mapping.closed_loop,
    )
    topics = (
        RecordedTopic(
            CHANNELS_TOPIC,
            definitions["ChannelInfo"],
            TopicQos(durability="transient_local", depth=1),
        ),
        RecordedTopic(IO_TOPIC, definitions["IoSample"]),
    )
    with whole_bag(bag_path, topics) as bag:
        raw = bytes(typestore.serialize_cdr(info, info_type.__msgtype__))
        bag.write(CHANNELS_TOPIC, raw, 0, 0)
        stamps_ns = [
            round(place * _NS / record.sampling.rate_hz)
            for place in record.sampling.places.tolist()
        ]
        for first in range(0, len(stamps_ns), _BLOCK_ROWS):
            block = slice(first, first + _BLOCK_ROWS)
            raws = _samples(typestore, header(0), record, np.array(stamps_ns[block]), block)
            for raw, stamp_ns in zip(raws, stamps_ns[block], strict=True):
                bag.write(IO_TOPIC, raw, stamp_ns, stamp_ns)


def _samples(
    typestore: Typestore, header: Msg, record: CsvRecord, stamps_ns: NDArray[np.int64], rows: slice
) -> list[bytes]:
    """Return some rows as serialised messages: all of them have the places of the first one."""
    inputs, outputs = record.inputs[rows], record.outputs[rows]
    sample_type = typestore.types["flexarm_msgs/msg/IoSample"]
    first = sample_type(header=header, sequence=0, inputs=inputs[0], outputs=outputs[0])
    raw = np.frombuffer(typestore.serialize_cdr(first, sample_type.__msgtype__), dtype=np.uint8)
    raws = np.tile(raw, (len(inputs), 1))
    layout = members(sample_type.__msgtype__, typestore.fielddefs)
    columns: dict[str, NDArray[Any]] = decode([(np.arange(len(raws)), raws)], layout)
    columns["header.stamp.sec"][:] = stamps_ns // _NS
    columns["header.stamp.nanosec"][:] = stamps_ns % _NS
    columns["sequence"][:] = record.sampling.places[rows] + 1
    columns["inputs"][:], columns["outputs"][:] = inputs, outputs
    return [each.tobytes() for each in raws]
