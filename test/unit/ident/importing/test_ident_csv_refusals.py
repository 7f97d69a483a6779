from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_bags.writer import RecordingError
from flexarm_core.bounds import BoundError
from flexarm_ident.importing import csv_record
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from support.bag_samples import typestore

if TYPE_CHECKING:
    from pathlib import Path

ONE_IN_ONE_OUT = CsvMap((CsvChannel("i", "current_a"),), (CsvChannel("q", "angle_deg"),), time="t")


def csv_file(folder: Path, lines: list[str]) -> Path:
    file = folder / "data.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


def drifting(first_hz: float, last_hz: float, samples: int) -> list[str]:
    """Return a table whose rate changes evenly from row to row."""
    steps_s = 1.0 / np.linspace(first_hz, last_hz, samples - 1)
    times_s = np.concatenate([[0.0], np.cumsum(steps_s)])
    return ["t,i,q", *(f"{time_s:.9f},1,{k}" for k, time_s in enumerate(times_s.tolist()))]


def test_import___rate_that_drifts___is_refused_with_its_rates(tmp_path: Path) -> None:
    # The middle is 0.06 / 8 of 1468 samples off even steps.
    file = csv_file(tmp_path, drifting(500.0, 470.0, 1468))
    said = r"column t has no even rate: 49\d\.\d* Hz at first, 47\d\.\d* Hz at last, up to 11\.\d"
    with pytest.raises(CsvImportError, match=said):
        import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("step_s", [1.09, 0.91])
def test_import___one_step_nine_percent_off___is_taken(tmp_path: Path, step_s: float) -> None:
    file = csv_file(tmp_path, with_one_step(step_s))
    summary = import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())
    assert summary.rate_hz == pytest.approx(1.0, rel=2e-3)


@pytest.mark.parametrize("step_s", [1.11, 0.89])
def test_import___one_step_eleven_percent_off___is_refused(tmp_path: Path, step_s: float) -> None:
    file = csv_file(tmp_path, with_one_step(step_s))
    said = rf"data\.csv, line 62: column t has an irregular step, {step_s} s, usually 1 s"
    with pytest.raises(CsvImportError, match=said):
        import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())


def with_one_step(step_s: float) -> list[str]:
    """Return a table of 1 Hz with another step in its middle."""
    times_s = [*range(60), *(59.0 + step_s + k for k in range(60))]
    return ["t,i,q", *(f"{time_s:.9f},1,{k}" for k, time_s in enumerate(times_s))]


def test_import___clock_that_wanders_by_a_part_in_ten_thousand___is_taken(tmp_path: Path) -> None:
    file = csv_file(tmp_path, drifting(500.0, 499.95, 5000))
    summary = import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())
    assert summary.rate_hz == pytest.approx(500.0, rel=1e-12)


def test_import___longer_than_stamps_can_show___is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Two million rows take long to read.
    monkeypatch.setattr(csv_record, "_LATEST_S", 1500)
    file = csv_file(tmp_path, ["i,q", "1,2", "1,2", "1,2"])
    mapping = CsvMap(ONE_IN_ONE_OUT.inputs, ONE_IN_ONE_OUT.outputs, rate_hz=1e-3)
    with pytest.raises(CsvImportError, match=r"3 rows at 0\.001 Hz last longer than 1500 s"):
        import_csv(file, mapping, tmp_path / "bag", typestore=typestore())
    assert not (tmp_path / "bag").exists()


def test_import___pipe___is_refused_unread(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "data.csv")
    with pytest.raises(BoundError, match=r"data\.csv: is not a plain file"):
        import_csv(tmp_path / "data.csv", ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_import___broken_off___leaves_no_half_of_a_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    file = csv_file(tmp_path, ["t,i,q", "0,1,2", "1,3,4"])
    written: list[int] = []

    def full(*_: object) -> None:
        written.append(1)
        if len(written) > 2:
            raise failure

    with monkeypatch.context() as patched:
        patched.setattr("mcap.writer.Writer.add_message", full)
        said = "No space left on device; nothing is kept"
        wanted = RecordingError if isinstance(failure, OSError) else KeyboardInterrupt
        with pytest.raises(wanted) as caught:
            import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())
    assert wanted is KeyboardInterrupt or said in str(caught.value)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["data.csv"]
    import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())
