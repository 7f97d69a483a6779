"""The campaign of `bench/bag_faults.py` with few cases; the whole of it takes minutes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING

from support.project import BENCH

if TYPE_CHECKING:
    from pathlib import Path


def run_bench(name: str, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603 - our own benchmark
        [sys.executable, str(BENCH / name), *options],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )


def test_bags___cut_with_wrong_bits_and_mutated___lose_at_most_a_second_and_never_lie(
    tmp_path: Path,
) -> None:
    file = tmp_path / "faults.json"
    done = run_bench(
        "bag_faults.py",
        *("--seconds", "6", "--cuts", "8", "--flips", "30", "--mutations", "120"),
        *("--seed", "7", "--json", str(file)),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(file.read_text("utf-8"))
    assert 0.0 < figures["most_lost_s"] <= 1.0
    assert figures["unnoticed_flips"] == 0
    assert figures["wrong"] == []
    assert figures["read"] + figures["refused"] == 120
    assert figures["refused"] > 50
