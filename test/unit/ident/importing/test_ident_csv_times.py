"""Rate of a CSV file by its column of times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_ident import read_bag
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
