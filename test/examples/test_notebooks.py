"""The notebooks of `examples`: every cell runs, and what it shows is right."""

from __future__ import annotations

import ast
import json
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import pytest
from matplotlib import pyplot as plt

from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.slow
FOLDER = PROJECT / "examples" / "notebooks"


@pytest.fixture(autouse=True)
def at_the_notebooks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(FOLDER)
    with mpl.rc_context({"backend": "agg"}):
        yield
    plt.close("all")


def cells(file: Path) -> list[dict[str, Any]]:
    content: dict[str, Any] = json.loads(file.read_text("utf-8"))
    found: list[dict[str, Any]] = content["cells"]
    return found


def run(name: str) -> tuple[dict[str, Any], list[Any]]:
    """Run a notebook and return its names and what its cells end with, as Jupyter shows it."""
    names: dict[str, Any] = {}
    shown: list[Any] = []
    for cell in cells(FOLDER / f"{name}.ipynb"):
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, name, "exec"), names)  # noqa: S102 - our own notebook
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), name, "eval"), names))  # noqa: S307
    return names, shown


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.ipynb")), ids=lambda file: str(file.stem))
def test_notebook___as_it_is_kept___has_no_results_of_some_machine(file: Path) -> None:
    for cell in cells(file):
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


def test_bag_to_modes___shows_the_bending_modes_and_simulates_unseen_data() -> None:
    names, shown = run("bag_to_modes")
    tables = [each._repr_html_() for each in shown if hasattr(each, "_repr_html_")]
    assert [table.count("<table>") for table in tables] == [1, 1, 1]
    physical_hz = [mode.mode.frequency_hz for mode in names["model"].recurring_modes]
    assert any(abs(hz - 9.4) < 0.5 for hz in physical_hz)
    assert names["reduced"].order <= 9
    assert names["check"].mean < 0.5
    assert len(plt.get_fignums()) == 4


def test_csv_to_friction___finds_the_level_with_which_the_arm_arrives() -> None:
    names, _ = run("csv_to_friction")
    assert 0.4 < names["level_v"] < 0.75
    errors = [abs(3.0 - names[each].y[-300:, 0].mean()) for each in ("without", "compensated")]
    assert errors[0] > 0.3
    assert errors[1] < 0.15


def test_laws_compared___tuned_and_packaged_laws_arrive(capsys: pytest.CaptureFixture[str]) -> None:
    names, _ = run("laws_compared")
    for name, run_of_it in names["runs"].items():
        assert abs(run_of_it.y[-300:, 0].mean() - 3.0) < 0.1, name
    assert "settling time (5 %)" in capsys.readouterr().out
    assert all(each.gain_margin_db > 9.9 for each in names["tuning"].margins)


def test_notebooks___are_listed_where_one_looks_for_them() -> None:
    page = (PROJECT / "docs" / "howto" / "notebooks.md").read_text("utf-8")
    files = list(FOLDER.glob("*.ipynb"))
    assert files
    assert all(file.name in page for file in files)
