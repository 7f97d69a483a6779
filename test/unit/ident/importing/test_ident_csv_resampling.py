"""CSV rows at uneven times: resampled by request, against closed forms and a known vibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.linalg import expm

from flexarm_bags.schema import own_types
from flexarm_ident import identify, read_bag
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap, load_csv_map

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_ident import IoData

    Array = NDArray[np.float64]

RATE_HZ = 100.0
MAP = CsvMap((CsvChannel("u", "u"),), (CsvChannel("y", "y"),), time="t", rate_hz=RATE_HZ)


def uneven(rows: int, seed: int = 0) -> Array:
    """Return times of a loop that sleeps: each step is some 30 % longer or shorter."""
    steps = np.random.default_rng(seed).uniform(0.7, 1.3, rows - 1) / RATE_HZ
    return np.concatenate([[0.0], np.cumsum(steps)])


def written(folder: Path, times_s: Array, u: Array, y: Array) -> Path:
    file = folder / "run.csv"
    rows = zip(times_s.tolist(), u.tolist(), y.tolist(), strict=True)
    lines = [f"{t!r},{a!r},{'' if np.isnan(b) else repr(b)}" for t, a, b in rows]
    file.write_text("\n".join(["t,u,y", *lines]) + "\n", encoding="utf-8")
    return file


def imported(folder: Path, times_s: Array, u: Array, y: Array) -> IoData:
    bag = folder / "bag"
    import_csv(written(folder, times_s, u, y), MAP, bag, typestore=own_types())
    return read_bag(bag)


def test_resampling___slow_sine_and_steps___is_their_value_and_their_mean(tmp_path: Path) -> None:
    times_s = uneven(2000)
    u = np.where(times_s < 7.0035, 1.0, 3.0)
    data = imported(tmp_path, times_s, u, np.sin(2.0 * np.pi * 2.0 * times_s))
    assert data.dt_s == pytest.approx(1.0 / RATE_HZ)
    even_s = np.arange(len(data)) / RATE_HZ
    assert data.y[:, 0] == pytest.approx(np.sin(2.0 * np.pi * 2.0 * even_s), abs=2e-3)
    change_s = times_s[times_s >= 7.0035][0]
    row = int(change_s * RATE_HZ)
    expected = np.where(even_s < change_s, 1.0, 3.0)
    expected[row] = 1.0 + 2.0 * (row + 1 - change_s * RATE_HZ)
    assert data.u[:, 0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("last_s", [0.0907, 0.0993])
def test_resampling___input_of_the_last_row___acts_for_a_period(
    tmp_path: Path, last_s: float
) -> None:
    times_s = np.append(0.01 * np.arange(10) - 0.002 * (np.arange(10) % 2), last_s)
    u = np.append(np.ones(10), 4.0)
    data = imported(tmp_path, times_s, u, times_s)
    # The last even row is at 0.09 s, and the last value acts from its own row on.
    assert data.u[:, 0] == pytest.approx([*np.ones(9), 1.0 + 3.0 * (0.1 - last_s) / 0.01])


def test_resampling___vibration_under_a_held_input___has_its_frequency(tmp_path: Path) -> None:
    times_s, mode_hz, damping = uneven(6000), 6.0, 0.02
    rate = 2.0 * np.pi * mode_hz
    A = np.array([[0.0, 1.0], [-(rate**2), -2.0 * damping * rate]])
    joined = np.zeros((3, 3))
    joined[:2, :2], joined[1, 2] = A, rate**2
    rng = np.random.default_rng(1)
    u = np.repeat(1.0 * rng.choice([-1.0, 1.0], 600), 10)
    x, y = np.zeros(3), np.empty(len(u))
    for k, step_s in enumerate(np.append(np.diff(times_s), 1.0 / RATE_HZ)):
        x[2], y[k] = u[k], x[0]
        x = expm(joined * step_s) @ x
    data = imported(tmp_path, times_s, u, y + 0.01 * rng.normal(size=len(y)))
    (mode,) = identify(data, order=2).modes
    assert mode.frequency_hz == pytest.approx(mode_hz, rel=2e-3)
    assert mode.damping_ratio == pytest.approx(damping, rel=0.1)


def test_resampling___long_gap_and_cells_without_a_value___are_holes(tmp_path: Path) -> None:
    times_s = uneven(1000)
    times_s[500:] += 0.5
    y = np.cos(times_s)
    y[200:210] = np.nan
    data = imported(tmp_path, times_s, np.ones(1000), y)
    missing = ~data.usable
    even_s = np.arange(len(data)) / RATE_HZ
    inside = (even_s > times_s[499] + 0.006) & (even_s < times_s[500] - 0.006)
    assert missing[inside].all()
    assert 55 < np.count_nonzero(missing) < 70
    assert data.y[~missing, 0] == pytest.approx(np.cos(even_s[~missing]), abs=1e-3)


@pytest.mark.parametrize(
    ("times_s", "said"),
    [
        (np.array([0.0, 0.01, 0.01, 0.02]), "line 4: column t does not increase"),
        (np.arange(50) / 20.0, r"rate_hz 100 is far from that of the rows, 20 Hz: choose 16 to 25"),
        (np.array([0.0, 0.01]), "2 rows are too few to resample"),
        (np.concatenate([np.arange(50), 200 + np.arange(50)]) / RATE_HZ, "150 of 250 rows"),
    ],
)
def test_resampling___that_cannot_be___is_refused(
    tmp_path: Path, times_s: Array, said: str
) -> None:
    rows = np.ones(len(times_s))
    with pytest.raises(CsvImportError, match=said):
        imported(tmp_path, times_s, rows, rows)


def test_refusal_of_uneven_times___names_the_keys___that_resample(tmp_path: Path) -> None:
    times_s = uneven(300)
    file = written(tmp_path, times_s, np.ones(300), np.ones(300))
    columns = tmp_path / "columns.yaml"
    text = "time: t\ninputs: [{column: u}]\noutputs: [{column: y}]\n"
    columns.write_text(text, encoding="utf-8")
    with pytest.raises(CsvImportError, match=r"by a map with rate_hz: \d+\S* beside the time"):
        import_csv(file, load_csv_map(columns), tmp_path / "bag", typestore=own_types())
    columns.write_text(f"{text}rate_hz: 100\n", encoding="utf-8")
    made = import_csv(file, load_csv_map(columns), tmp_path / "bag", typestore=own_types())
    assert made.rate_hz == pytest.approx(100.0)
    assert made.notes == ("300 rows were resampled to 100 Hz",)
