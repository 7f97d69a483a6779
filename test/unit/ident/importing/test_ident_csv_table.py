"""Tests of cells in forms that the fast way of reading does not know."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import TableColumns
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from flexarm_ident.importing.csv_record import read_csv
from flexarm_ident.importing.csv_table import column_names, read_table

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flexarm_ident import IoData

MAP = CsvMap(inputs=(CsvChannel("i", "i"),), outputs=(CsvChannel("q", "q"),), time="t")


@pytest.mark.parametrize(
    ("old", "new"),
    [("2.5,", '"2.5",'), ("2.5,", " 2.5 ,"), ("10000\n", "10_000\n"), ("1e-3", "1E-003")],
    ids=["quotes", "spaces", "underscore", "exponent"],
)
def test_table___cell_in_another_form___has_the_same_numbers_and_lines(
    tmp_path: Path, old: str, new: str
) -> None:
    rows = [f"{k},{k * 2.5 + 1e-3!r},{k * 10000}" for k in range(200)]
    plain = tmp_path / "plain.csv"
    plain.write_text("\n".join(["t,i,q", "0,2.5,1e-3", *rows[1:]]) + "\n")
    expected = read_table(plain, MAP)
    other = tmp_path / "other.csv"
    text = plain.read_text()
    assert old in text
    other.write_text(text.replace(old, new, 1))
    found = read_table(other, MAP)
    np.testing.assert_array_equal(found.values, expected.values)
    np.testing.assert_array_equal(expected.lines, np.arange(2, 202))
    np.testing.assert_array_equal(found.lines, expected.lines)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("0,07,2,5,1", r"line 9: it has 5 cells, and the first line names 3: .*decimal commas"),
        ("7,2.5,1,9", r"line 9: it has 4 cells"),
        ('7,"2.5",1,9', r"line 9: it has 4 cells"),
    ],
)
def test_table___row_with_more_cells_than_names___is_refused(
    tmp_path: Path, row: str, words: str
) -> None:
    rows = [f"{k},2.5,{k}" for k in range(200)]
    rows[7] = row
    file = tmp_path / "run.csv"
    file.write_text("\n".join(["t,i,q", *rows]) + "\n")
    with pytest.raises(CsvImportError, match=words):
        read_table(file, MAP)


def test_table___row_with_empty_cells_at_its_end___is_read(tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("t,i,q\n" + "".join(f"{k},2.5,{k},,\n" for k in range(200)))
    np.testing.assert_array_equal(read_table(file, MAP).values[:, 2], np.arange(200.0))


def record_of(folder: Path, text: bytes) -> IoData:
    (folder / "run.csv").write_bytes(text)
    return read_csv(folder / "run.csv", TableColumns(("u",), ("y",)))


def rows_of(count: int, clock: Callable[[int], int] = lambda k: k) -> str:
    return "t_ms,u,y\n" + "".join(f"{clock(k)},{k % 7},{k % 5}.{k % 10}25\n" for k in range(count))


@pytest.mark.parametrize(
    "end", ["100,2,0.0", "100,2", "100,", "10", "100,2,0.0" + 900 * "\0"], ids=repr
)
def test_read___log_that_was_cut_off___lacks_its_last_row(tmp_path: Path, end: str) -> None:
    whole = record_of(tmp_path, rows_of(100).encode())
    found = record_of(tmp_path, (rows_of(100) + end).encode())
    np.testing.assert_array_equal(found.y, whole.y)
    assert [each.text for each in found.notices] == ["the last line is cut off: left out"]


@pytest.mark.parametrize("end", ["", "100,2,0.025", "done", 5000 * "\0"])
def test_read___log_that_ends_without_a_line_end___is_whole(tmp_path: Path, end: str) -> None:
    found = record_of(tmp_path, (rows_of(100) + end).encode())
    assert (len(found), found.notices) == (100 + end.count("100,2"), ())


def test_read___rows_that_were_never_written___are_left_out_with_a_note(tmp_path: Path) -> None:
    found = record_of(tmp_path, (rows_of(100) + 50 * "0,0,0.000\n").encode())
    assert len(found) == 100
    assert "lines 102 to 151 are left out" in found.notices[0].text


def test_read___counter_of_time_that_begins_anew___is_reported(tmp_path: Path) -> None:
    found = record_of(tmp_path, rows_of(100, lambda k: (2**16 - 50 + k) % 2**16).encode())
    assert len(found) == 100
    assert found.dt_s == pytest.approx(1e-3)
    assert "column t_ms is a counter that begins anew" in found.notices[0].text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,name,v\n" + "".join(f"{k // 2},{'uy'[k % 2]},{k}.5\n" for k in range(60)), "pivot"),
        ("time,signal,v\n" + "".join(f"{k},u,{k}.5\n" for k in range(60)), "column signal says"),
        ("".join(f"data:\n- {k}.5\n- 0.25\nstamp:\n  sec: {k}\n---\n" for k in range(60)), "--csv"),
        ("".join(f"({k}.5) can0 12{k % 3}#00AB{k % 10}\n" for k in range(60)), "cantools"),
        ("".join(f">u:{k}:0.5\n>y:{k}:1.5\n" for k in range(60)), "one value a row"),
        (
            "t," + ",".join(map(str, range(99))) + "\nu" + 99 * ",1" + "\ny" + 99 * ",2\n",
            "transpose",
        ),
    ],
    ids=["long", "long by blocks", "topic echo", "candump", "teleplot", "transposed"],
)
def test_layout___of_no_column_for_each_signal___is_refused_with_what_to_do(
    tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(CsvImportError, match=said):
        column_names(tmp_path / "run.csv")


@pytest.mark.parametrize(
    "text",
    [
        "t,mode,y\n" + "".join(f"{k},{'run' if k > 30 else 'idle'},{k}.5\n" for k in range(60)),
        "".join(f"u: {k}.5 y: 1.5\n" for k in range(60)),
    ],
    ids=["words that stay", "named pairs"],
)
def test_layout___of_a_table_with_words___is_taken(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.csv").write_text(text)
    assert "y" in column_names(tmp_path / "run.csv")
