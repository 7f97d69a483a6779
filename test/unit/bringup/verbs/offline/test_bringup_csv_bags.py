from __future__ import annotations

from typing import TYPE_CHECKING

import click
import numpy as np
import pytest

from flexarm_bringup.verbs.offline.csv_bags import as_bags
from flexarm_daq.importing.csv_import import CsvImportError
from flexarm_ident import read_bag

if TYPE_CHECKING:
    from pathlib import Path

MAP = "time: t\ninputs: [{column: u, name: drive_v}]\noutputs: [{column: y, name: angle_v}]\n"


@pytest.fixture
def columns(tmp_path: Path) -> Path:
    path = tmp_path / "columns.yaml"
    path.write_text(MAP)
    return path


def table(path: Path, separator: str = ",") -> Path:
    rows = [("t", "u", "y"), *((0.01 * k, k % 3, 2 * k) for k in range(50))]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(separator.join(map(str, row)) for row in rows))
    return path


def test_csv___beside_a_bag___is_a_bag_of_its_name_while_it_is_read(
    tmp_path: Path, columns: Path
) -> None:
    tables = [table(tmp_path / folder / "run.csv") for folder in ("a", "b")]
    with as_bags([*tables, tmp_path / "bag"], columns) as found:
        assert [path.name for path in found] == ["run", "run", "bag"]
        assert found[2] == tmp_path / "bag"
        record = read_bag(found[0])
        assert np.allclose(record.y[:, 0], 2.0 * np.arange(len(record)))
    assert not found[0].exists()


def test_csv___without_a_map___is_told_what_is_missing(tmp_path: Path) -> None:
    with (
        pytest.raises(click.UsageError, match=r"run\.csv is a CSV file: --map FILE says"),
        as_bags([tmp_path / "run.csv"], None),
    ):
        pass


def test_map___without_a_csv___is_refused(tmp_path: Path, columns: Path) -> None:
    with pytest.raises(click.UsageError, match="none is named"), as_bags([tmp_path], columns):
        pass


@pytest.mark.parametrize(("separator", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_csv___with_another_separator___is_told_its_name(
    tmp_path: Path, columns: Path, separator: str, name: str
) -> None:
    path = table(tmp_path / "run.csv", separator)
    with (
        pytest.raises(CsvImportError, match=rf"separated by {name}, not by commas"),
        as_bags([path], columns),
    ):
        pass
