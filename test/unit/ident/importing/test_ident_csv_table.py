"""Tests of cells in forms that the fast way of reading does not know."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.importing.csv_layout import CsvImportError
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from flexarm_ident.importing.csv_table import read_table

if TYPE_CHECKING:
    from pathlib import Path

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
