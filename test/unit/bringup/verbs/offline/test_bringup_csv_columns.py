from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_bringup.verbs.offline.channel_options import taken_columns
from flexarm_ident.importing.csv_columns import TableColumns
from flexarm_ident.importing.csv_map import load_csv_map
from flexarm_ident.job import read_whole

MAP = "time: t\ninputs: [{column: u, name: drive_v}]\noutputs: [{column: y, name: angle_v}]\n"


@pytest.fixture
def columns(tmp_path: Path) -> Path:
    path = tmp_path / "columns.yaml"
    path.write_text(MAP)
    return path


def table(path: Path, separator: str = ",", *, samples: int = 50) -> Path:
    rows = [("t", "u", "y"), *((0.01 * k, k % 3, 2 * k) for k in range(samples))]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(separator.join(map(str, row)) for row in rows))
    return path


@pytest.mark.parametrize("again", ["run.csv", "./run.csv", "bag", "link"])
def test_path___that_is_named_twice___is_refused(
    tmp_path: Path, columns: Path, monkeypatch: pytest.MonkeyPatch, again: str
) -> None:
    monkeypatch.chdir(tmp_path)
    table(Path("run.csv"))
    Path("link").symlink_to("bag")
    paths = [Path("run.csv"), Path("bag"), Path(again)]
    reported = rf"^{Path(again)} is named twice, and would count"
    with pytest.raises(click.UsageError, match=reported):
        taken_columns(paths, columns, {"inputs": (), "outputs": ()})


@pytest.mark.slow
def test_each___of_csv_files___has_them_by_their_names_and_knows_them_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first_order(Path("long.csv"))
    table(Path("short.csv"), samples=40)
    words = "identify --each long.csv short.csv --input u --output y --order 1 --no-friction -o out"
    for again in ("", ", 1 of them there already"):
        done = CliRunner().invoke(main, [*words.split(), "--jobs", "1"], prog_name="flexarm")
        assert done.exit_code == 1
        reported = " ".join(done.stdout.split())
        assert f"1 model{again}; table in out/models.csv" in reported
        assert "no model of short.csv: short.csv: 40 samples are too few" in reported
        assert Path("out/long_csv/model.yaml").exists()
        with Path("out/models.csv").open(encoding="utf-8", newline="") as stream:
            assert [row["bag"] for row in csv.DictReader(stream)] == ["long.csv", "short.csv"]


def test_csv___without_a_map___is_refused_with_what_is_missing(tmp_path: Path) -> None:
    reported = r"run\.csv is a CSV file: .*--input COLUMN .*--map FILE; columns: t, u, y"
    with pytest.raises(click.UsageError, match=reported):
        taken_columns([table(tmp_path / "run.csv")], None, {"inputs": (), "outputs": ()})


def first_order(path: Path) -> None:
    """Write a record of a first-order rig with noise."""
    rng = np.random.default_rng(5)
    noise, u = 0.1 * rng.standard_normal(4000), rng.standard_normal(4000)
    y = np.zeros(4000)
    for k in range(4000):
        y[k] = (0.9 * y[k - 1] + 0.2 * u[k - 1] if k else 0.0) + noise[k]
    rows = np.column_stack([0.01 * np.arange(4000), u, y])
    np.savetxt(path, rows, delimiter=",", header="time,u,y", comments="")


def test_csv___with_named_columns___is_a_record_whose_loop_nobody_says(tmp_path: Path) -> None:
    path = table(tmp_path / "run.csv")
    record = read_whole(path, TableColumns(("drive_v=u",), ("y",)))
    assert record.label == str(path)
    assert (record.inputs, record.outputs) == (("drive_v",), ("y",))
    assert record.closed_loop is None


def test_taken_columns__csv_without_a_map___are_taken_from_the_options(tmp_path: Path) -> None:
    options: dict[str, Any] = {"inputs": ("u",), "outputs": ("y",), "clock": None}
    found = taken_columns([table(tmp_path / "run.csv")], None, options)
    assert found == TableColumns(("u",), ("y",))
    assert options == {"inputs": (), "outputs": (), "clock": None}


def test_taken_columns__bags_and_maps___leave_the_options(tmp_path: Path, columns: Path) -> None:
    options = {"inputs": ("/a.data",), "outputs": ("/b.data",)}
    assert taken_columns([tmp_path / "bag"], None, options) is None
    assert options == {"inputs": ("/a.data",), "outputs": ("/b.data",)}
    none: dict[str, Any] = {"inputs": (), "outputs": ()}
    assert taken_columns([tmp_path / "run.csv"], columns, none) == load_csv_map(columns)
    with pytest.raises(click.UsageError, match="give --map, or --input, --output and --time"):
        taken_columns([tmp_path / "run.csv"], columns, options)


def test_taken_columns__of_a_csv_beside_a_bag___are_refused(tmp_path: Path) -> None:
    options = {"inputs": ("u",), "outputs": ("y",)}
    with pytest.raises(click.UsageError, match="columns of CSV files or signals of bags"):
        taken_columns([table(tmp_path / "run.csv"), tmp_path], None, options)
    with pytest.raises(click.UsageError, match="no file or bag 'strain' is there"):
        taken_columns([tmp_path / "run.csv", Path("strain")], None, options)


def test_map___without_a_csv___is_refused(tmp_path: Path, columns: Path) -> None:
    with pytest.raises(click.UsageError, match="none is named"):
        taken_columns([tmp_path], columns, {"inputs": (), "outputs": ()})


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "|"])
@pytest.mark.parametrize("ending", ["csv", "tsv", "txt", "dat", "TXT"])
def test_table___of_any_ending_and_separator___is_read(
    tmp_path: Path, columns: Path, ending: str, separator: str
) -> None:
    path = table(tmp_path / f"run.{ending}", separator)
    record = read_whole(path, load_csv_map(columns))
    assert np.allclose(record.y[:, 0], 2.0 * np.arange(50))
    assert np.allclose(record.u[:, 0], np.arange(50) % 3)
