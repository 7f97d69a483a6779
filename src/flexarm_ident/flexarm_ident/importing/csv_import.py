"""Import of measurements from a CSV file into a bag.

The first row has time 0, and each row stands whole sampling intervals later; where rows are missing
their numbers are too. An output that was not measured is NaN. Header stamp, log time and publish
time of a message are the instant of its row. The channel information is written once, at time 0,
before the first sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.records.columns import decode, members
from flexarm_bags.schema import describe
from flexarm_bags.writer import whole_bag
from flexarm_ident.importing.csv_record import csv_record

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from rosbags.typesys.store import Msg, Typestore

    from flexarm_bags.schema import MessageDefinition
    from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
    from flexarm_ident.importing.csv_record import CsvRecord

IO_TOPIC = "/flexarm/io"
CHANNELS_TOPIC = "/flexarm/io_channels"
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


def import_csv(
    csv_path: Path,
    mapping: CsvMap,
    bag_path: Path,
    *,
    typestore: Typestore,
    folder_of: Callable[[str], Path | None] | None = None,
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

    Returns
    -------
    ImportSummary
        Samples, rate, hash and holes.

    Raises
    ------
    CsvImportError, BoundError
        As `csv_record` raises them.
    RecordingError
        If the bag exists or cannot be written.
    """
    record = csv_record(csv_path, mapping)
    mapping = record.mapping
    digest = _hash(csv_path)
    resampling = f"rows resampled to {mapping.rate_hz:g} Hz" if mapping.resamples else ""
    parts = (mapping.description, f"{csv_path.name} sha256:{digest}", resampling)
    definitions = {
        name: describe(typestore, f"flexarm_msgs/msg/{name}", folder_of)
        for name in ("IoSample", "ChannelInfo")
    }
    _write(bag_path, typestore, definitions, record, source="; ".join(filter(None, parts)))
    rows, last = len(record.inputs), int(record.sampling.places[-1])
    return ImportSummary(
        bag_path,
        rows,
        record.sampling.rate_hz,
        last / record.sampling.rate_hz,
        digest,
        missing_rows=last + 1 - rows,
        missing_cells=int(np.isnan(record.outputs).sum()),
        notes=record.notes,
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

    mapping = record.mapping
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
        stamps_ns = record.stamps_ns
        for first in range(0, len(stamps_ns), _BLOCK_ROWS):
            block = slice(first, first + _BLOCK_ROWS)
            raws = _samples(typestore, header(0), record, stamps_ns[block], block)
            for raw, stamp_ns in zip(raws, stamps_ns[block].tolist(), strict=True):
                bag.write(IO_TOPIC, raw, stamp_ns, stamp_ns)


def _samples(
    typestore: Typestore, header: Msg, record: CsvRecord, stamps_ns: NDArray[np.int64], rows: slice
) -> list[bytes]:
    """Return some rows as serialised messages: all of them have the places of the first one."""
    inputs, outputs = record.inputs[rows], record.outputs[rows]
    sample_type = typestore.types["flexarm_msgs/msg/IoSample"]
    first = sample_type(
        header=header,
        sequence=0,
        inputs=inputs[0],
        outputs=outputs[0],
        compensations=np.empty(0),
        command_sequence=0,
    )
    raw = np.frombuffer(typestore.serialize_cdr(first, sample_type.__msgtype__), dtype=np.uint8)
    raws = np.tile(raw, (len(inputs), 1))
    layout = members(sample_type.__msgtype__, typestore.fielddefs)
    columns: dict[str, NDArray[Any]] = decode([(np.arange(len(raws)), raws)], layout)
    columns["header.stamp.sec"][:] = stamps_ns // _NS
    columns["header.stamp.nanosec"][:] = stamps_ns % _NS
    columns["sequence"][:] = record.sampling.places[rows] + 1
    columns["inputs"][:], columns["outputs"][:] = inputs, outputs
    return [each.tobytes() for each in raws]
