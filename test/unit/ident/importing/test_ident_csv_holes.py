"""Tests of missing cells and missing rows of a CSV file."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from flexarm_ident.importing.csv_record import read_csv
from flexarm_ident.reading.read import read_bag, stream_bag
from support.bag_samples import typestore

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_ident.importing.csv_import import ImportSummary

MAP = CsvMap(
    inputs=(CsvChannel("u", "drive_v"),),
    outputs=(CsvChannel("p", "angle_v"), CsvChannel("q", "strain_v")),
    time="t",
)
ROWS = 200
OUT = slice(60, 69)


def imported(folder: Path, rows: Sequence[str], mapping: CsvMap = MAP) -> ImportSummary:
    header = "t,u,p,q" if mapping.time else "u,p,q"
    (folder / "run.csv").write_text("\n".join([header, *rows]) + "\n")
    return import_csv(folder / "run.csv", mapping, folder / "bag", typestore=typestore())


def signals() -> np.ndarray:
    """Return u, p and q of which each row differs from all others."""
    k = np.arange(ROWS)
    return np.column_stack([np.sin(k), 10.0 + k, np.cos(0.1 * k)])


def lines(times_s: np.ndarray) -> list[str]:
    return [
        ",".join(map(repr, (t, *row)))
        for t, row in zip(times_s.tolist(), signals().tolist(), strict=True)
    ]


@pytest.mark.parametrize("cell", ["", "nan", "NaN", "NA", "n/a", " ", "-nan", "null"])
def test_missing_cell_of_an_output___is_missing_there_alone(tmp_path: Path, cell: str) -> None:
    rows = lines(0.01 * np.arange(ROWS))
    t, u, p, _ = rows[50].split(",")
    rows[50] = f"{t},{u},{p},{cell}"

    summary = imported(tmp_path, rows)
    record = read_bag(tmp_path / "bag")

    assert (summary.samples, summary.missing_rows, summary.missing_cells) == (ROWS, 0, 1)
    assert record.missing is not None
    assert np.argwhere(record.missing).tolist() == [[50, 1]]
    np.testing.assert_array_equal(record.u[:, 0], signals()[:, 0])
    known = ~record.missing
    np.testing.assert_array_equal(record.y[known], signals()[:, 1:][known])
    # The cubic through four samples of a slow cosine is off by its fourth derivative.
    assert record.y[50, 1] == pytest.approx(np.cos(5.0), abs=0.1**4)


def test_missing_last_cells___may_lack_their_commas(tmp_path: Path) -> None:
    rows = lines(0.01 * np.arange(ROWS))
    rows[50:-1:10] = [row.rpartition(",")[0] for row in rows[50:-1:10]]
    assert imported(tmp_path, rows).missing_cells == len(rows[50:-1:10])


def test_row___that_lacks_a_cell_alone___is_missing(tmp_path: Path) -> None:
    rows = lines(0.01 * np.arange(ROWS))
    # A newline that was lost makes one cell of two.
    rows[50] = "0.5,-1,601"
    summary = imported(tmp_path, rows)
    assert (summary.missing_rows, summary.missing_cells) == (1, 0)
    assert summary.notes[0].startswith("line 52 has fewer cells than the others: left out")


@pytest.mark.parametrize("late_s", [0.0, 0.0037])
def test_missing_rows___are_a_hole_in_time(tmp_path: Path, late_s: float) -> None:
    times_s = 0.01 * np.arange(ROWS)
    # A long hole may end anywhere: its length is rounded to whole periods.
    times_s[OUT.stop :] += late_s
    rows = lines(times_s)
    summary = imported(tmp_path, rows[: OUT.start] + rows[OUT.stop :])
    record = read_bag(tmp_path / "bag")

    assert (summary.samples, summary.missing_rows) == (ROWS - 9, 9)
    assert summary.rate_hz == pytest.approx(100.0, rel=1e-12)
    assert summary.duration_s == pytest.approx(1.99, rel=1e-12)
    assert np.flatnonzero(~record.usable).tolist() == list(range(OUT.start, OUT.stop))
    np.testing.assert_array_equal(record.y[record.usable], signals()[:, 1:][record.usable])
    assert (record.u[OUT] == signals()[OUT.start - 1, 0]).all()
    assert record.input_held is not None
    assert np.flatnonzero(record.input_held).tolist() == list(range(OUT.start, OUT.stop))
    (notice,) = record.notices
    assert notice.code == "lost_samples"
    assert "9 of 200 periods are without a sample, in 1 hole, from" in notice.text
    streamed = [y for _, y in stream_bag(tmp_path / "bag").chunks(ROWS)]
    np.testing.assert_array_equal(np.concatenate(streamed), record.y_usable)


def test_holes_of_five_periods_and_a_part___leave_the_rate_as_it_is(tmp_path: Path) -> None:
    # They are the shortest whose length is rounded: beyond five periods no row is near.
    times_s = 0.01 * np.arange(ROWS) + 0.044 * (np.arange(ROWS) // 20)
    summary = imported(tmp_path, lines(times_s))
    assert summary.rate_hz == pytest.approx(100.0, rel=1e-12)
    assert (summary.samples, summary.missing_rows) == (ROWS, 9 * 4)


@pytest.mark.parametrize(("part", "is_taken"), [(4.91, True), (4.88, False), (5.15, True)])
def test_gap_about_five_periods___is_a_hole_of_any_length_from_five_on(
    tmp_path: Path, part: float, *, is_taken: bool
) -> None:
    times_s = 0.01 * np.arange(ROWS) + np.where(np.arange(ROWS) < 100, 0.0, 0.01 * (part - 1.0))
    if is_taken:
        assert imported(tmp_path, lines(times_s)).missing_rows == 4
    else:
        with pytest.raises(CsvImportError, match="irregular step"):
            imported(tmp_path, lines(times_s))


def test_rows_at_few_digits_of_time___keep_their_places_behind_a_long_hole(tmp_path: Path) -> None:
    # Steps of 3.3 and 3.4 ms in print: the usual one would count 2727 periods in the hole.
    places = np.concatenate([np.arange(3000), np.arange(5700, 8700)])
    rows = [f"{k / 300:.4f},{k % 7},{k},{k}" for k in places.tolist()]
    imported(tmp_path, rows)
    record = read_bag(tmp_path / "bag")
    assert record.dt_s == pytest.approx(1 / 300, rel=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(record.usable), places)


def test_rows_before_and_behind_all_outputs___are_left_out_and_reported(tmp_path: Path) -> None:
    rows = lines(0.01 * np.arange(ROWS))
    for k in range(20):
        rows[k] = rows[k].rpartition(",")[0] + ","
    t, u, _, q = rows[-1].split(",")
    rows[-1] = f"{t},{u},,{q}"
    summary = imported(tmp_path, rows)
    record = read_bag(tmp_path / "bag")
    assert summary.notes == (
        "lines 2 to 21 are left out: q has no value there yet",
        "line 201 is left out: p has no value any more",
    )
    assert (summary.samples, summary.missing_cells, record.missing) == (ROWS - 21, 0, None)
    np.testing.assert_array_equal(record.y, signals()[20:-1, 1:])


def test_outputs_that_never_meet___are_refused(tmp_path: Path) -> None:
    with pytest.raises(CsvImportError, match=r"run\.csv: p ends before q begins: leave one of"):
        imported(tmp_path, ["0,1,2,", "1,2,3,", "2,1,,4", "3,2,,4"])


def test_missing_input___is_refused_with_two_ways_out_where_rows_have_no_time(
    tmp_path: Path,
) -> None:
    mapping = CsvMap(MAP.inputs, MAP.outputs, rate_hz=100.0)
    said = (
        r"run\.csv, line 3, column u: empty cell; an input must be known in every row: fill it, or "
        "empty all cells of the row: that makes a hole$"
    )
    with pytest.raises(CsvImportError, match=said):
        imported(tmp_path, ["1,2,3", ",2,3", "1,2,3"], mapping)
    said = r"line 3, column u: .*: fill it, or take the line out: that makes a hole$"
    with pytest.raises(CsvImportError, match=said):
        imported(tmp_path, ["0,1,2,3", "1,NA,2,3", "2,1,2,3"])


def test_read_csv___with_holes___is_the_record_of_the_bag(tmp_path: Path) -> None:
    rows = lines(0.01 * np.arange(ROWS))
    rows[20] = rows[20].rpartition(",")[0]
    imported(tmp_path, [*rows[:30], *rows[33:]])
    record, kept = read_csv(tmp_path / "run.csv", MAP), read_bag(tmp_path / "bag")
    assert record.input_held is not None
    assert np.flatnonzero(record.input_held).tolist() == [20, 30, 31, 32]
    np.testing.assert_array_equal(record.u, kept.u)
    np.testing.assert_array_equal(record.y_measured, kept.y_measured)


@pytest.mark.parametrize("blank", [",,,", " , ,,", ""])
def test_rows_of_empty_cells___beside_times___are_missing_rows(tmp_path: Path, blank: str) -> None:
    rows = lines(0.01 * np.arange(ROWS))
    rows[OUT] = [blank] * len(rows[OUT])
    summary = imported(tmp_path, [*rows, blank, blank, "  "])
    missing = OUT.stop - OUT.start
    assert (summary.samples, summary.missing_rows) == (ROWS - missing, missing)
    assert summary.notes == ()


def test_rows_of_empty_cells___without_times___keep_the_places_of_the_others(
    tmp_path: Path,
) -> None:
    rows = [row.partition(",")[2] for row in lines(np.zeros(ROWS))]
    rows[OUT] = [",,"] * len(rows[OUT])
    mapping = replace(MAP, time=None, rate_hz=100.0)
    summary = imported(tmp_path, [",,", *rows[:100], "", *rows[100:], ",,", ""], mapping)
    missing = OUT.stop - OUT.start
    assert (summary.samples, summary.missing_rows) == (ROWS - missing, missing)
    # From the first row to the last one; a line without cells is none.
    assert summary.duration_s == pytest.approx((ROWS - 1) / 100.0)
    record = read_bag(tmp_path / "bag")
    assert record.missing is not None
    assert np.flatnonzero(record.missing.all(axis=1)).tolist() == list(range(OUT.start, OUT.stop))
    np.testing.assert_array_equal(record.y[OUT.stop :], signals()[OUT.stop :, 1:])
