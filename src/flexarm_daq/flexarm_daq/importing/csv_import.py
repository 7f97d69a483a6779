"""Import of measurements from a CSV file into a bag, so that every later step reads bags only.

The first row has time 0, and row k is sampled k sampling intervals later. Header stamp, log time
and publish time of a message are that instant. The channel information is written once, at time 0,
before the first sample.
"""

from __future__ import annotations

import csv
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from itertools import islice
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import describe
from flexarm_bags.writer import whole_bag
from flexarm_core.bounds import require_plain_file, shown
from flexarm_core.errors import FlexarmError
from flexarm_daq.importing.csv_map import FASTEST_HZ, SLOWEST_HZ, is_rate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path
    from typing import TextIO

    from numpy.typing import NDArray
    from rosbags.typesys.store import Msg, Typestore

    from flexarm_bags.schema import MessageDefinition
    from flexarm_daq.importing.csv_map import CsvChannel, CsvMap

IO_TOPIC = "/flexarm/io"
CHANNELS_TOPIC = "/flexarm/io_channels"
# Largest difference of a step from the median one: times are often printed with few digits.
STEP_TOLERANCE = 0.1
# Largest relative difference of a rate from a whole number of hertz that is rounded, and largest
# relative change of a rate within the file.
WHOLE_RATE_TOLERANCE = 1e-3
_HALF_A_STEP = 0.5
# A line of a table has some hundred characters.
_LINE_CHARACTERS = 1 << 20
# Seconds of a stamp are an int32.
_LATEST_S = 2**31 - 1
_BLOCK_ROWS = 50_000
_NS = 1_000_000_000


class CsvImportError(FlexarmError):
    """Contradiction between the CSV file and its map."""


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
    """

    bag: Path
    samples: int
    rate_hz: float
    duration_s: float
    sha256: str


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
        Columns and their names; see :func:`flexarm_daq.importing.csv_map.load_csv_map`.
    bag_path : Path
        Folder to create.
    typestore : Typestore
        Types with ``flexarm_msgs``; see :func:`flexarm_bags.schema.load_typestore`.
    folder_of : callable, optional
        Folders of the messages' files; see :func:`flexarm_bags.schema.describe`.

    Returns
    -------
    ImportSummary
        Samples, rate and hash.

    Raises
    ------
    CsvImportError
        If the file cannot be read, lacks a column, has fewer than 2 rows, a cell that is no finite
        number, irregular or drifting time steps, or times that stamps cannot show. The message
        names file, line and column.
    BoundError
        If it is no plain file.
    RecordingError
        If the bag exists or cannot be written.
    """
    table = _read_table(csv_path, mapping.columns())
    if mapping.time is None:
        rate_hz = mapping.rate_hz
        values = table
    else:
        rate_hz = _sampling_rate_hz(table[:, 0], csv_path, mapping.time)
        values = table[:, 1:]
    if rate_hz is None:
        raise CsvImportError(f"{csv_path}: the map names neither a time column nor rate_hz")
    _require_stamps(csv_path, len(values), rate_hz)
    digest = _hash(csv_path)
    source = f"{csv_path.name} sha256:{digest}"
    if mapping.description:
        source = f"{mapping.description}; {source}"
    definitions = {
        name: describe(typestore, f"flexarm_msgs/msg/{name}", folder_of)
        for name in ("IoSample", "ChannelInfo")
    }
    _write(bag_path, typestore, definitions, mapping, values, rate_hz=rate_hz, source=source)
    return ImportSummary(bag_path, len(values), rate_hz, (len(values) - 1) / rate_hz, digest)


def _require_stamps(path: Path, rows: int, rate_hz: float) -> None:
    if not is_rate(rate_hz):
        raise CsvImportError(
            f"{path}: a rate of {rate_hz:.6g} Hz is outside {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz: "
            "times are in seconds"
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


def _read_table(path: Path, columns: Sequence[str]) -> NDArray[np.float64]:
    """Return the columns as an array, (rows, columns)."""
    with _opened(path) as (header, rows):
        indices = _indices(header, columns, path)
        blocks = []
        # Only one block is held as text.
        while block := list(islice(rows, _BLOCK_ROWS)):
            blocks.append(_to_numbers(block, indices, columns, path))
    table = np.concatenate(blocks) if blocks else np.empty((0, len(columns)))
    if len(table) < 2:  # noqa: PLR2004 - one sampling interval needs two rows
        raise CsvImportError(f"{path}: data rows: {len(table)}; at least 2 are needed")
    return table


def column_names(path: Path) -> list[str]:
    """Return the names in the first line of a CSV file.

    Raises
    ------
    CsvImportError
        If the file cannot be read, or its columns are not separated by commas.
    """
    with _opened(path) as (header, _):
        return header


@contextmanager
def _opened(path: Path) -> Iterator[tuple[list[str], Iterator[Row]]]:
    """Open a CSV file, and yield the names in its first line, and its other rows."""
    try:
        require_plain_file(path)
        # utf-8-sig: spreadsheets put a byte order mark in front of the first name.
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(_lines(file, path))
            header = [name.strip() for name in next(reader, [])]
            for separator, name in ((";", "semicolons"), ("\t", "tabs")):
                if len(header) == 1 and separator in header[0]:
                    problem = f"its columns are separated by {name}, not by commas"
                    advice = "save it with commas, and with points in its numbers"
                    raise CsvImportError(f"{path}: {problem}: {advice}")
            yield header, ((reader.line_num, row) for row in reader if row)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CsvImportError(f"{path}: cannot read as CSV: {error}") from error


def _lines(file: TextIO, path: Path) -> Iterator[str]:
    while line := file.readline(_LINE_CHARACTERS):
        if len(line) == _LINE_CHARACTERS:
            raise CsvImportError(f"{path}: a line has {_LINE_CHARACTERS} characters or more")
        yield line


def _indices(header: Sequence[str], columns: Sequence[str], path: Path) -> list[int]:
    for column in columns:
        if header.count(column) != 1:
            problem = "no column" if column not in header else "more than one column"
            raise CsvImportError(
                f"{path}: {problem} {column}; there are: {shorten(', '.join(header), 500)}"
            )
    return [header.index(column) for column in columns]


Row = tuple[int, "list[str]"]


def _to_numbers(
    rows: Sequence[Row], indices: Sequence[int], columns: Sequence[str], path: Path
) -> NDArray[np.float64]:
    try:
        numbers = np.array([[float(row[index]) for index in indices] for _, row in rows])
    except (ValueError, IndexError):
        numbers = np.full((len(rows), len(indices)), np.nan)
    if not np.isfinite(numbers).all():
        _report_bad_cell(rows, indices, columns, path)
    return numbers


def _report_bad_cell(
    rows: Iterable[Row], indices: Sequence[int], columns: Sequence[str], path: Path
) -> None:
    for line, row in rows:
        for index, column in zip(indices, columns, strict=True):
            cell = row[index].strip() if index < len(row) else ""
            where = f"{path}: line {line}, column {column}"
            if not cell:
                raise CsvImportError(f"{where}: empty cell; fill the cell")
            try:
                number = float(cell)
            except ValueError as error:
                raise CsvImportError(f"{where}: {shown(cell)} is not a number") from error
            if not np.isfinite(number):
                raise CsvImportError(f"{where}: {number} is not finite; fill the cell")


def _sampling_rate_hz(times_s: NDArray[np.float64], path: Path, column: str) -> float:
    """Return the rate of equidistant times; a rate near a whole number is rounded."""
    steps_s = np.diff(times_s)
    usual_s = float(np.median(steps_s))
    if usual_s <= 0:
        raise CsvImportError(f"{path}: column {column} does not increase")
    worst = int(np.argmax(np.abs(steps_s - usual_s)))
    if abs(steps_s[worst] - usual_s) > STEP_TOLERANCE * usual_s:
        raise CsvImportError(
            f"{path}: column {column} has irregular steps: {steps_s[worst]:.6g} s after"
            f" t = {times_s[worst]:.6g} s (data row {worst + 1}), usually {usual_s:.6g} s;"
            " resample or cut the file"
        )
    rate_hz = len(steps_s) / float(times_s[-1] - times_s[0])
    _refuse_drift(times_s, rate_hz, path, column)
    whole = round(rate_hz)
    return float(whole) if abs(rate_hz - whole) <= WHOLE_RATE_TOLERANCE * rate_hz else rate_hz


def _refuse_drift(times_s: NDArray[np.float64], rate_hz: float, path: Path, column: str) -> None:
    """Refuse times whose steps change slowly: each is like the usual one, their sum is not.

    A rate that changes evenly by a part d puts the middle of N samples d N / 8 samples off.
    """
    samples = np.arange(len(times_s))
    off = np.abs((times_s - times_s[0]) * rate_hz - samples)
    if off.max() <= _HALF_A_STEP + WHOLE_RATE_TOLERANCE * len(times_s) / 8:
        return
    tenth = max(1, len(times_s) // 10)
    first_hz = tenth / float(times_s[tenth] - times_s[0])
    last_hz = tenth / float(times_s[-1] - times_s[-1 - tenth])
    raise CsvImportError(
        f"{path}: column {column} has no even rate: {first_hz:.6g} Hz at first, {last_hz:.6g} Hz at"
        f" last, up to {off.max():.1f} samples off even steps; resample the file"
    )


def _write(
    bag_path: Path,
    typestore: Typestore,
    definitions: Mapping[str, MessageDefinition],
    mapping: CsvMap,
    values: NDArray[np.float64],
    *,
    rate_hz: float,
    source: str,
) -> None:
    sample_type = typestore.types["flexarm_msgs/msg/IoSample"]
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
        sampling_rate_hz=rate_hz,
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
    inputs = values[:, : len(input_names)]
    outputs = values[:, len(input_names) :]
    with whole_bag(bag_path, topics) as bag:
        raw = bytes(typestore.serialize_cdr(info, info_type.__msgtype__))
        bag.write(CHANNELS_TOPIC, raw, 0, 0)
        for row in range(len(values)):
            stamp_ns = round(row * _NS / rate_hz)
            sample = sample_type(
                header=header(stamp_ns),
                sequence=row + 1,
                inputs=inputs[row],
                outputs=outputs[row],
            )
            raw = bytes(typestore.serialize_cdr(sample, sample_type.__msgtype__))
            bag.write(IO_TOPIC, raw, stamp_ns, stamp_ns)
