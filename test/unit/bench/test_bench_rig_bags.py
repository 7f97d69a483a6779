from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

from support.project import BENCH

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        ("rig", ("times_real_time", "sampled_times_real_time")),
        ("bags", ("ratio_to_anyreader", "read_bag_messages_per_s", "read_bag_40_s_bag_s")),
    ],
)
def test_bench___few_seconds___gives_its_figures(
    tmp_path: Path, name: str, figures: tuple[str, ...]
) -> None:
    file = tmp_path / "figures.json"
    done = subprocess.run(  # noqa: S603 - our own benchmark
        [sys.executable, str(BENCH / f"{name}.py"), "--seconds", "5", "--json", str(file)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(file.read_text("utf-8"))
    assert all(found[figure] > 0.0 for figure in figures)
    assert "5 s" in done.stdout
