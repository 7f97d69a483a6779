"""The campaign of `flexarm bench bag_faults` with few cases; the whole of it takes minutes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from support.benchmarks import run_bench

if TYPE_CHECKING:
    from pathlib import Path


def test_bags___cut_with_wrong_bits_and_mutated___lose_at_most_a_second_and_never_lie(
    tmp_path: Path,
) -> None:
    file = tmp_path / "faults.json"
    done = run_bench(
        "bags.bag_faults",
        *("--seconds", "6", "--cuts", "4", "--flips", "15", "--mutations", "60"),
        *("--seed", "7", "--json", str(file)),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(file.read_text("utf-8"))
    assert 0.0 < figures["most_lost_s"] <= 1.0
    assert figures["unnoticed_flips"] == 0
    assert figures["wrong"] == []
    assert figures["read"] + figures["refused"] == 60
    assert figures["refused"] > 25
