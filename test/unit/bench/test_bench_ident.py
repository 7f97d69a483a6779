from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

BENCH = Path(__file__).parents[3] / "bench"


def run_ident(*options: str, cache: Path) -> subprocess.CompletedProcess[str]:
    source = str(BENCH.parent / "src" / "flexarm_ident")
    environment = {"PYTHONPATH": source, "XDG_CACHE_HOME": str(cache), "PATH": "/usr/bin:/bin"}
    return subprocess.run(  # noqa: S603 - our own benchmark
        [sys.executable, str(BENCH / "ident.py"), *options],
        capture_output=True,
        text=True,
        check=False,
        env={**environment, "COLUMNS": "120"},
    )


def test_bench_ident___quick___rows_and_missing_peers_are_named(tmp_path: Path) -> None:
    file = tmp_path / "rows.json"
    done = run_ident("--quick", "--json", str(file), cache=tmp_path)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(file.read_text("utf-8"))
    assert {key: row[key] for key in ("method", "noise", "k", "seeds", "unstable", "failure")} == {
        "method": "orse",
        "noise": "white",
        "k": 2000,
        "seeds": 1,
        "unstable": 0,
        "failure": None,
    }
    assert row["cpu_s"] > 0.0
    assert row["memory_mb"] > 0.0
    # The noise alone is 0.1 % to 20 % of the outputs.
    assert 0.0 < row["error"] < 0.05
    missing = " ".join(done.stdout.split("not installed:")[1].split())
    assert missing.startswith("ctrlsys, sippy, mdof")


def test_bench_ident___unknown_option___fails(tmp_path: Path) -> None:
    assert run_ident("--fast", cache=tmp_path).returncode == 2
