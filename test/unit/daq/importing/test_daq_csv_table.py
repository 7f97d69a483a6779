"""Tests of cells in forms that the fast way of reading does not know."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_daq.importing.csv_map import CsvChannel, CsvMap
from flexarm_daq.importing.csv_table import read_table

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
