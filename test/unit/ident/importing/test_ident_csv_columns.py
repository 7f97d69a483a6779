"""Tests of the map that the names of columns make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import TableColumns, named_columns, unused_time
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from flexarm_ident.importing.csv_record import csv_record
from flexarm_ident.importing.csv_table import column_names

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def table(folder: Path, header: str) -> Path:
    path = folder / "run.csv"
    path.write_text(f"{header}\n0,1,2,3\n0.1,1,2,3\n")
    return path


@pytest.mark.parametrize(
    "time",
    [
        *("t", "time", "Time", "time_s", "t_s", "Time [s]", "time (sec)", "timestamp", "seconds"),
        *("ms", "__time", "X_Value", "Elapsed Time [ms]", "time_stamp"),
        *("time_ms", "t [ms]", "T/ms", "Zeit", "t_min", "timestamp_ns"),
        *("Latest: Time (s)", "Time (s) Run #1", "time#1", "Run 1 time"),
    ],
)
def test_named_columns__usual_name_of_the_time___is_taken(tmp_path: Path, time: str) -> None:
    found = named_columns(table(tmp_path, f"{time},i,q,temperature"), TableColumns(("i",), ("q",)))
    assert found == CsvMap((CsvChannel("i", "i"),), (CsvChannel("q", "q"),), time=time)


def test_named_columns__other_name___is_that_in_the_bag(tmp_path: Path) -> None:
    path = table(tmp_path, "t,i=0,q,tau")
    found = named_columns(path, TableColumns(("drive_v=tau", "i=0"), ("angle_v=q",)))
    assert found.inputs == (CsvChannel("tau", "drive_v"), CsvChannel("i=0", "i=0"))
    assert found.outputs == (CsvChannel("q", "angle_v"),)


@pytest.mark.parametrize(
    ("header", "inputs", "outputs", "words"),
    [
        ("t,i,q,x", [], ["q"], r"needs --input COLUMN and --output COLUMN; columns: t, i, q, x"),
        ("t,i,q,x", ["i"], [], r"needs --input COLUMN"),
        ("", ["i"], ["q"], r"--time COLUMN:us or --time 200Hz.* there are: 0, 1, 2, 3"),
        ("hello", ["i"], ["q"], r"it has numbers alone: put a line with the names .*column_4"),
        ("t,i,q,x", ["t"], ["q"], r"t is the time: it is neither an input nor an output"),
        (
            "clock,i,q,x",
            ["i"],
            ["q"],
            r"no column is called a time, such as t or time_ms: .*rate_hz.*: clock, i, q, x",
        ),
        ("t,i,q,time_s", ["i"], ["q"], r"t and time_s are times: .*time: COLUMN"),
        ("t,i,q,x", ["i"], ["i"], r"i is named twice"),
        ("t,i,q,x", ["a=i"], ["a=q"], r"a is named twice"),
        ("0,1.5,2,3", ["i"], ["q"], r"numbers alone: put a line with the names of.* column_1, "),
        ("0,0,0,0", ["i"], ["q"], r"numbers alone"),
        ("t i q x", ["i"], ["q"], r"numbers alone"),
    ],
)
def test_named_columns__what_names_no_record___is_refused(
    tmp_path: Path, header: str, inputs: list[str], outputs: list[str], words: str
) -> None:
    with pytest.raises(CsvImportError, match=words):
        named_columns(table(tmp_path, header), TableColumns(tuple(inputs), tuple(outputs)))


def test_column_names__data_frame_without_names___are_its_counted_columns(tmp_path: Path) -> None:
    assert column_names(table(tmp_path, "0,1,2,3")) == ["0", "1", "2", "3"]


def test_column_names__sentences_in_comments___are_none(tmp_path: Path) -> None:
    text = "# Created by Octave 8.4.0, Fri Dec 19\n# type: matrix\n# columns: 4"
    names = column_names(table(tmp_path, text))
    assert names == ["column_1", "column_2", "column_3", "column_4"]


def test_named_columns__missing_file___is_reported(tmp_path: Path) -> None:
    with pytest.raises(CsvImportError, match=r"run\.csv: cannot be read as CSV"):
        named_columns(tmp_path / "run.csv", TableColumns(("i",), ("q",)))


@pytest.mark.parametrize(
    ("own", "reported"),
    [
        (lambda k: 0.02 * k + 7.0, True),
        (lambda k: 0.010001 * k + 7.0, False),
        (lambda k: 1e7 * k + 1.7e18, False),
        (lambda k: 0.0 * k, False),
        (lambda k: -0.02 * k, False),
        (lambda k: 1.0 * k, False),
    ],
    ids=["half the rate", "same rate", "nanoseconds", "constant", "backwards", "count"],
)
def test_other_clocks___second_device_in_the_rows___is_reported(
    tmp_path: Path, *, own: Callable[[int], float], reported: bool
) -> None:
    rows = [f"{0.01 * k},{k % 3},{k % 7},{own(k)!r}" for k in range(50)]
    (tmp_path / "run.csv").write_text("\n".join(["t,u,q,t_imu", *rows]) + "\n")
    mapping = named_columns(tmp_path / "run.csv", TableColumns(("u",), ("q",)))
    notes = csv_record(tmp_path / "run.csv", mapping).notes
    assert any("t_imu is a clock of another rate than t" in note for note in notes) == reported


@pytest.mark.parametrize(
    ("header", "mapping", "unused"),
    [
        ("time_s,i,q,x", {"rate_hz": 10.0}, "time_s"),
        ("time_s,i,q,x", {"rate_hz": 10.0, "time": "time_s"}, ""),
        ("clock,i,q,x", {"rate_hz": 10.0}, ""),
        ("q,i,t,x", {"rate_hz": 10.0}, "t"),
    ],
)
def test_unused_time___map_with_a_rate_alone___is_reported(
    tmp_path: Path, header: str, mapping: dict[str, float | str], unused: str
) -> None:
    channels = (CsvChannel("i", "i"),), (CsvChannel("q", "q"),)
    notes = unused_time(table(tmp_path, header), CsvMap(*channels, **mapping))  # type: ignore[arg-type]
    start = f"column {unused} was not used: the map puts the rows at 10 Hz"
    assert [note.startswith(start) for note in notes] == [True] * bool(unused)
