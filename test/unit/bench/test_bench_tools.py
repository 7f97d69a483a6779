from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.tools import make_table, run_trials, write_json
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
    assert json.loads(file.read_text("utf-8")) == [{"name": "orse", "error": 0.5}]


def test_make_table___columns_of_figures___are_set_to_the_right() -> None:
    table = make_table("noise", "method", "error", words=2)
    assert [column.justify for column in table.columns] == ["left", "left", "right"]


def test_run_trials___results___come_in_the_order_of_the_cases() -> None:
    assert run_trials(abs, [-3, 2, -1]) == [3, 2, 1]


def test_verb___each_bench___is_one_file_of_one_folder() -> None:
    for name in bench.commands:
        assert len(list(PROJECT.glob(f"bench/*/{name}.py"))) == 1
