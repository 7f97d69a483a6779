"""Rows of a series, as a table and as a plot."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import pytest

from flexarm_core.errors import DataError
from flexarm_ident.series.rows import Row, read_rows, trend_page, trend_plot, write_rows

if TYPE_CHECKING:
    from pathlib import Path


def a_row(bag: str, begun: str = "", **cells: str) -> Row:
    modes = {"frequency_1": "4.1", "damping_1": "0.03", "weight_1": "1", "frequency_2": "80"}
    return Row(bag, {"begun": begun, "error_mean": "0.1", **modes, "weight_2": "0.001", **cells})


def test_rows___written___come_back(tmp_path: Path) -> None:
    rows = [
        a_row("a", "2026-01-01T00:00:00+00:00", frequency_10="200", weight_10="0.5"),
        Row("b, c", {"failure": 'no "such" bag'}),
        a_row("d", error_angle="0.2", friction_u="0.3", friction_u_std="0.01"),
    ]
    file = tmp_path / "models.csv"
    write_rows(file, rows)
    found = read_rows(file)
    assert [found[row.bag].failure for row in rows] == ["", 'no "such" bag', ""]
    assert found["d"].number("friction_u") == pytest.approx(0.3)
    assert list(found["d"].main_modes()) == [(4.1, 1.0)]
    with file.open(newline="") as stream:
        header = next(csv.reader(stream))
    # The figures of the model, its modes in the order of their numbers, and what made it.
    assert header[9:13] == ["error_angle", "friction_u", "friction_u_std", "frequency_1"]
    assert header.index("frequency_2") < header.index("frequency_10")
    assert header[-3:] == ["failure", "record_sha256", "request_sha256"]
    assert [each.name for each in tmp_path.iterdir()] == ["models.csv"]


def test_row___of_record_and_request___is_known() -> None:
    made = {"record_sha256": "r", "request_sha256": "q"}
    assert Row("a", made).is_of("r", "q")
    assert not Row("a", made).is_of("r", "p")
    assert not Row("a", {**made, "failure": "too short"}).is_of("r", "q")


@pytest.mark.parametrize("text", ["t,u\n1,2\n", "bag,price\nred,12\n"])
def test_table___of_something_else___is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "models.csv"
    file.write_text(text)
    with pytest.raises(DataError, match=r"models\.csv: no table of a series: .* move it away"):
        read_rows(file)


def test_trend___different_begins___stand_over_time() -> None:
    days = [a_row(str(day), f"2026-03-0{day}T08:00:00+00:00") for day in (1, 2, 5)]
    shown = trend_plot(days)
    assert "begin of the record, days from 2026-03-01 08:00 UTC on" in shown
    # Four days, and the room of a twentieth on either side.
    assert 'data-x="-0.2 4.2"' in shown


def test_trend___imported_records_that_begin_at_0___stand_over_their_numbers() -> None:
    rows = [
        a_row(str(number), "1970-01-01T00:00:00+00:00", friction_command_v="0.2")
        for number in range(3)
    ]
    shown = trend_plot(rows)
    assert "begin" not in shown
    assert "friction level" in shown
    assert "command, V" in shown


def test_page___bag_without_a_model___says_why() -> None:
    rows = [a_row("a<b"), Row("c", {"failure": "too short & flat"})]
    page = trend_page(rows, "", {"a<b": "a_b/report.html"}, "models.csv")
    assert "1 model of 2 bags" in page
    assert "too short &amp; flat" in page
    assert '<a href="a_b/report.html">a&lt;b</a>' in page
