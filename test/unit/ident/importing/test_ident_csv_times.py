"""Rate of a CSV file by its column of times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_ident import read_bag
from flexarm_ident.importing.csv_cells import clock_s, is_clock
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from support.bag_samples import typestore

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_ident.importing.csv_import import ImportSummary


def imported(folder: Path, times: list[str]) -> ImportSummary:
    rows = [f"{time},{k % 7},{k % 5}" for k, time in enumerate(times)]
    (folder / "run.csv").write_text("\n".join(["t,i,q", *rows]))
    mapping = CsvMap((CsvChannel("i", "i"),), (CsvChannel("q", "q"),), time="t")
    return import_csv(folder / "run.csv", mapping, folder / "bag", typestore=typestore())


def test_rate___times_printed_with_few_digits___is_the_whole_one(tmp_path: Path) -> None:
    summary = imported(tmp_path, [f"{k / 300:.4f}" for k in range(601)])
    assert summary.rate_hz == pytest.approx(300.0, rel=1e-12)


def test_rate___long_record_beside_a_whole_rate___is_its_own(tmp_path: Path) -> None:
    summary = imported(tmp_path, [f"{k * 0.005004:.6f}" for k in range(6000)])
    assert summary.rate_hz == pytest.approx(1.0 / 0.005004, rel=1e-9)
    assert read_bag(tmp_path / "bag").dt_s == pytest.approx(0.005004, rel=1e-9)


@pytest.mark.parametrize("rate_hz", [200.0, 187.3])
def test_rate___whole_seconds_of_many_rows___is_that_of_the_rows(
    tmp_path: Path, rate_hz: float
) -> None:
    summary = imported(tmp_path, [f"12:04:{int(14.3 + k / rate_hz):02d}" for k in range(4000)])
    # Each stamp's first row is less than a period late.
    assert summary.rate_hz == pytest.approx(rate_hz, rel=1.0 / 3500)


@pytest.mark.parametrize(
    ("text", "since_s"),
    [
        ("1970-01-01T00:00:01Z", 1.0),
        ("1970-01-02 00:00:00.123456789", 86400.123456789),
        ("1970-01-01 02:00:00+02:00", 0.0),
        ("1970-01-01 01:30:00-0130", 10800.0),
        ("02.01.1970 00:00:00,5", 86400.5),
        ("1/2/1970 12:00:01 AM", 86401.0),
        ("1/2/1970 1:00 PM", 133200.0),
        ("13/1/1970 0:00", 1036800.0),
        ("23:59:59.25", 86399.25),
        ("01:02.5", 62.5),
        ("02-Jan-1970 00:00:01.5", 86401.5),
        ("02.01.70 00:00:01:250", 86401.25),
        ("2 days 00:00:01", 172801.0),
        ("1.5 min", 90.0),
    ],
)
def test_clock___in_a_usual_form___is_its_seconds(text: str, since_s: float) -> None:
    assert is_clock(text)
    assert clock_s(text) == pytest.approx(since_s, abs=1e-9)


@pytest.mark.parametrize("text", ["", "Z", "1.5", "-3", "1:2:3:4", "noon", "1e-5", "192.168.0.1"])
def test_clock___that_is_none___is_refused(text: str) -> None:
    assert not is_clock(text)
    with pytest.raises(ValueError, match=r".*"):
        clock_s(text)
