from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click
import pytest
from click.testing import CliRunner

from bench.tools import FAULTS_PAGE, json_option, make_table, run_trials, write_json, write_table
from flexarm_bringup.verbs.checkout.bench import bench
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class Row:
    name: str
    error: float


def test_write_json___rows___are_objects_in_a_new_folder(tmp_path: Path) -> None:
    file = tmp_path / "new" / "rows.json"
    write_json(file, [Row("orse", 0.5)])
    (row,) = json.loads(file.read_text("utf-8"))
    assert (row["name"], row["error"]) == ("orse", pytest.approx(0.5))


def test_write_table___of_one_benchmark___leaves_the_others(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(FAULTS_PAGE.read_text("utf-8"), "utf-8")
    before = page.read_text("utf-8").splitlines()
    names = ("faults", "schedules", "mutants")
    for name in names:
        write_table(page, name, ["what"], [[f"row of {name}"]])
    lines = page.read_text("utf-8").splitlines()
    assert [line for line in lines if line.startswith("| row")] == [
        f"| row of {name} |" for name in names
    ]
    assert [line for line in lines if line[:1] != "|"] == [
        line for line in before if line[:1] != "|"
    ]


def test_write_table___page_without_its_place___is_refused_and_stays(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("Text.\n", "utf-8")
    with pytest.raises(ValueError, match="no place for the table of bench laws"):
        write_table(page, "laws", ["what"], [["a"]])
    assert page.read_text("utf-8") == "Text.\n"


@click.command()
@json_option
@click.option("--rows", is_flag=True)
def measure(*, json_file: Path | None, rows: bool) -> None:
    """Stand in for a benchmark."""
    click.echo("measured")
    write_json(json_file, [Row("orse", 0.5), Row("pbsid", 0.6)] if rows else {"error": 0.5})


@pytest.mark.parametrize("kind", [(), ("--rows",)])
def test_json_file___of_an_earlier_measurement___is_replaced(
    tmp_path: Path, kind: tuple[str, ...]
) -> None:
    file = tmp_path / "figures.json"
    for _ in range(2):
        result = CliRunner().invoke(measure, ["--json", str(file), *kind])
        assert (result.exit_code, result.output) == (0, "measured\n")


def test_json_file___of_somebody_else___is_refused_before_the_measurement(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text('{"mine": true}', "utf-8")

    result = CliRunner().invoke(measure, ["--json", str(file)])

    assert result.exit_code == 1
    assert result.output.startswith(f"Error: {file}: was not written by flexarm: ")
    assert result.output.count("\n") == 1
    assert file.read_text("utf-8") == '{"mine": true}'
    forced = CliRunner().invoke(measure, ["--json", str(file), "--force"])
    assert forced.exit_code == 0
    assert json.loads(file.read_text("utf-8"))["error"] == pytest.approx(0.5)


def test_json_file___that_is_a_folder___is_refused_before_the_measurement(tmp_path: Path) -> None:
    result = CliRunner().invoke(measure, ["--json", str(tmp_path)])

    assert result.exit_code == 1
    assert result.output == f"Error: {tmp_path}: cannot be written: Is a directory\n"


def test_make_table___columns_of_figures___are_set_to_the_right() -> None:
    table = make_table("noise", "method", "error", words=2)
    assert [column.justify for column in table.columns] == ["left", "left", "right"]


def test_run_trials___results___come_in_the_order_of_the_cases() -> None:
    assert run_trials(abs, [-3, 2, -1]) == [3, 2, 1]


def test_verb___each_bench___is_one_file_of_one_folder() -> None:
    for name in bench.commands.keys() - {"all"}:  # it runs others
        assert len(list(PROJECT.glob(f"bench/*/{name}.py"))) == 1
