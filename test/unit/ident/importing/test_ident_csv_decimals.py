"""Tests of decimal commas in tables whose columns are not separated by commas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.importing import csv_table
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from flexarm_ident.importing.csv_table import read_table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

MAP = CsvMap((CsvChannel("i", "i"),), (CsvChannel("q", "q"),), time="t")


def values(folder: Path, rows: Sequence[str], separator: str = ";") -> np.ndarray:
    text = "\n".join(["t;i;q;remark", *rows]).replace(";", separator)
    (folder / "run.csv").write_text(text)
    return read_table(folder / "run.csv", MAP).values


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas___between_other_separators___are_read(
    tmp_path: Path, separator: str
) -> None:
    rows = ["0;1,5;-2;x.y", "0,0050;2;;x,y", "0,0100;,5;1,5E-03;12.3"]
    found = values(tmp_path, rows, separator)
    wanted = [[0.0, 1.5, -2.0], [0.005, 2.0, np.nan], [0.01, 0.5, 0.0015]]
    # The hole is in the middle, so that no row is left out.
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["0;1.5;2", "1;1;2,5"], r"line 3, column q: '2,5', and .* write all with one of them"),
        (["0;1,5;2", "1;1;1,234,567"], r"line 3, column q: '1,234,567', and the file has commas"),
    ],
)
def test_numbers___with_marks_that_contradict___are_refused(
    tmp_path: Path, rows: list[str], said: str
) -> None:
    with pytest.raises(CsvImportError, match=said):
        values(tmp_path, rows)


def test_marks___that_contradict_in_two_portions___are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_table, "_BLOCK_ROWS", 2)
    with pytest.raises(CsvImportError, match=r"line 5, column q: '2\.5'"):
        values(tmp_path, ["0;1,5;2", "1;1;1", "2;1;1", "3;1;2.5"])


def test_decimal_commas___in_quotes_between_commas___are_read(tmp_path: Path) -> None:
    found = values(tmp_path, ['0,"1,5",2', '1,"1,234",3'], ",")
    np.testing.assert_allclose(found, [[0.0, 1.5, 2.0], [1.0, 1.234, 3.0]])


def test_decimal_commas___beside_points_between_commas___are_refused(tmp_path: Path) -> None:
    with pytest.raises(CsvImportError, match=r"line 3, column i: '1,5', and the file has commas"):
        values(tmp_path, ['0,"1,234",2.5', '1,"1,5",3.5'], ",")


def test_decimal_commas___between_commas___are_refused(tmp_path: Path) -> None:
    with pytest.raises(CsvImportError, match=r"line 2: it has 6 cells, and .* names 4.*need ;"):
        values(tmp_path, [f"0,00{k},1,5,2,{k}" for k in range(5)], ",")


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize("time", ["{:d}", "{:.1f}"])
def test_marks_of_thousands_alone___are_no_decimal_marks(
    tmp_path: Path, mark: str, time: str
) -> None:
    counts = [998, 999, 1000, 1001, -1200, 12_345]
    other = ",."[mark == ","]
    rows = [
        ";".join([time.format(k).replace(".", other), f"{count:,}".replace(",", mark), "-7"])
        for k, count in enumerate(counts)
    ]
    np.testing.assert_array_equal(values(tmp_path, rows)[:, 1], counts)


def test_three_decimals___beside_numbers_of_four_digits___are_decimals(tmp_path: Path) -> None:
    found = values(tmp_path, ["0;1.234;5", "1;1.001;1500", "2;9;1.125", "3;2000;2"])
    np.testing.assert_array_equal(found[:, 1], [1.234, 1.001, 9.0, 2000.0])
