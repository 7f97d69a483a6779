"""Files of references and trajectories: read back, and refused in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control.learning.columns import read_reference, read_trajectory, write_trajectory
from flexarm_control.learning.trajectory import SIGNALS, Trajectory
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from pathlib import Path

RATE_HZ = 300.0


def test_reference___of_three_lines___holds_each_value(tmp_path: Path) -> None:
    file = tmp_path / "reference.csv"
    file.write_text("# mine\ntime_s, reference_v\n1.0, 0\n1.01, 2\n1.02, -1\n")

    assert read_reference(file, RATE_HZ).tolist() == [0, 0, 0, 2, 2, 2, -1]


def test_trajectory___written_and_read___is_the_same(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    written = Trajectory(RATE_HZ, *random.uniform(-1.0, 1.0, (4, 50)))

    write_trajectory(tmp_path / "trajectory.csv", written)
    read = read_trajectory(tmp_path / "trajectory.csv")

    assert read.rate_hz == pytest.approx(RATE_HZ)
    for name in SIGNALS:
        np.testing.assert_allclose(getattr(read, name), getattr(written, name), rtol=1e-8)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no column time_s; the first line has nothing"),
        ("time_s;reference_v\n0;1\n", "no column time_s; .*with commas between them"),
        ("time_s,reference_v\n", "has no samples after its names"),
        ("time_s,reference_v\n0,far\n", "sample 1, reference_v = 'far': write a finite number"),
        ("time_s,reference_v\n0,inf\n", "sample 1, reference_v = 'inf'"),
        ("time_s,reference_v\n0\n", "sample 1, reference_v = None"),
        ("time_s,reference_v\n0,1\n2,1\n1,1\n", "time_s must rise, and does not after its value 2"),
        ("time_s,reference_v\n0,1\n1,99\n", "leaves the travel"),
        ("time_s,reference_v\n0,1\n9999,1\n", "lasts longer than 3600 s: cut it"),
    ],
)
def test_reference___in_a_wrong_file___is_refused(
    tmp_path: Path, text: str, complaint: str
) -> None:
    file = tmp_path / "reference.csv"
    file.write_text(text)

    with pytest.raises(SettingError, match=f"{file}: .*{complaint}"):
        read_reference(file, RATE_HZ)


def test_reference___without_a_file___is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"nowhere\.csv: cannot be read: No such file"):
        read_reference(tmp_path / "nowhere.csv", RATE_HZ)
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingError, match="cannot be read"):
        read_reference(tmp_path / "bytes.csv", RATE_HZ)


@pytest.mark.parametrize(
    ("times_s", "complaint"),
    [((0.0, 0.1, 0.3), "equal steps"), ((0.0,), "two samples at least")],
)
def test_trajectory___of_uneven_times___is_refused(
    tmp_path: Path, times_s: tuple[float, ...], complaint: str
) -> None:
    file = tmp_path / "trajectory.csv"
    lines = [",".join(("time_s", *SIGNALS)), *(f"{each},0,0,0,0" for each in times_s)]
    file.write_text("\n".join(lines))

    with pytest.raises(SettingError, match=complaint):
        read_trajectory(file)
