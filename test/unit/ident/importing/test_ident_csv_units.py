"""Tests of units: that of a table's time, which its name tells, and those of a map's channels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap, unit_notes
from support.bag_samples import typestore

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_ident.importing.csv_import import ImportSummary

RATE_HZ = 200.0


def imported(folder: Path, time: str, per_s: float) -> ImportSummary:
    """Import 2 s at 200 Hz whose times count so many to the second."""
    rows = [f"{k / RATE_HZ * per_s:.9g};1;{k}" for k in range(401)]
    (folder / "run.csv").write_text("\n".join([f"{time};i;q", *rows]))
    mapping = CsvMap((CsvChannel("i", "i"),), (CsvChannel("q", "q"),), time=time)
    return import_csv(folder / "run.csv", mapping, folder / "bag", typestore=typestore())


@pytest.mark.parametrize(
    ("time", "per_s"),
    [
        ("time_s", 1.0),
        ("time_ms", 1e3),
        ("t [ms]", 1e3),
        ("t[ms]", 1e3),
        ("Zeit (msec)", 1e3),
        ("Time/ms", 1e3),
        ("time, ms", 1e3),
        ("clock milliseconds", 1e3),
        ("time_us", 1e6),
        ("t [\u00b5s]", 1e6),
        ("t [\u03bcs]", 1e6),
        ("timestamp_ns", 1e9),
        ("t_min", 1 / 60),
        ("time (minutes)", 1 / 60),
    ],
)
def test_import___unit_in_the_name_of_the_time___scales_it(
    tmp_path: Path, time: str, per_s: float
) -> None:
    summary = imported(tmp_path, time, per_s)
    assert summary.rate_hz == pytest.approx(RATE_HZ, rel=1e-12)
    assert summary.duration_s == pytest.approx(2.0, rel=1e-12)
    assert summary.notes == ()


@pytest.mark.parametrize("time", ["t", "time", "items", "terms", "ms_clock"])
def test_import___name_without_a_unit___is_in_seconds(tmp_path: Path, time: str) -> None:
    assert imported(tmp_path, time, 1.0).rate_hz == pytest.approx(RATE_HZ, rel=1e-12)


def test_import___low_rate_of_a_name_without_a_unit___is_doubted(tmp_path: Path) -> None:
    summary = imported(tmp_path, "time", 1e3)
    assert summary.rate_hz == pytest.approx(0.2)
    (said,) = summary.notes
    assert said.startswith(
        "column time gives 0.2 Hz over 2000 s if its times are in s; are they in"
    )
    assert "--time 'time:ms' or --time 'time:s' (time_unit in a map)" in said


@pytest.mark.parametrize(("time", "per_s"), [("time_s", 1e3), ("t", 200.0)])
def test_import___low_rate_in_a_stated_unit_or_one_of_1_hz___is_not_doubted(
    tmp_path: Path, time: str, per_s: float
) -> None:
    assert imported(tmp_path, time, per_s).notes == ()


def test_import___rate_that_stamps_cannot_show___says_how_to_say_the_unit(tmp_path: Path) -> None:
    said = r"0\.0002 Hz is outside .* or in a unit at the end .* as in time_us; .*--time COLUMN:us"
    with pytest.raises(CsvImportError, match=said):
        imported(tmp_path, "time", 1e6)


@pytest.mark.parametrize(
    ("name", "unit", "note"),
    [
        (
            "torque",
            "Nm",
            "reports show the unit at the end of a name, as torque_nm: none that",
        ),
        (
            "angle",
            "counts",
            "reports show the unit at the end of a name: none that they know",
        ),
        ("hub_rad", "deg", "hub_rad is in deg by the map and in rad by its name, which reports go"),
        ("torque_nm", "N\u00b7m", ""),
        ("speed_rad_per_s", "rad/s", ""),
        ("level_v", "V (RMS)", ""),
        ("level_v", "mV", "level_v is in mV by the map and in V by its name, which reports go by"),
        ("place_m", "mm", "place_m is in mm by the map and in m by its name, which reports go by"),
        ("torque", "", ""),
    ],
)
def test_map___unit_that_no_name_says___is_reported(name: str, unit: str, note: str) -> None:
    mapping = CsvMap((CsvChannel("i", name, unit),), (CsvChannel("q", "q"),), time="t")
    notes = unit_notes(mapping)
    assert len(notes) == bool(note)
    assert all(note in each for each in notes)
