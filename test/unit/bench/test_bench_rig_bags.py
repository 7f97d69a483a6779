from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from support.benchmarks import run_bench

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        ("loop.rig", ("times_real_time", "sampled_times_real_time")),
        ("bags.bags", ("ratio_to_anyreader", "read_bag_messages_per_s", "read_bag_40_s_bag_s")),
    ],
)
@pytest.mark.exhaustive
def test_bench___few_seconds___gives_its_figures(
    tmp_path: Path, name: str, figures: tuple[str, ...]
) -> None:
    file = tmp_path / "figures.json"
    done = run_bench(name, "--seconds", "5", "--json", str(file))
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(file.read_text("utf-8"))
    assert all(found[figure] > 0.0 for figure in figures)
    assert "5 s" in done.stdout
