from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from bench.ident.ident import main
from support.benchmarks import run_bench

if TYPE_CHECKING:
    from pathlib import Path
    from subprocess import CompletedProcess

pytestmark = pytest.mark.slow


def run_ident(cache: Path, *options: str) -> CompletedProcess[str]:
    """Run the benchmark where no peer is installed."""
    return run_bench("ident.ident", *options, XDG_CACHE_HOME=str(cache), PATH="/usr/bin:/bin")


@pytest.mark.exhaustive
def test_bench_ident___quick___rows_and_missing_peers_are_named(tmp_path: Path) -> None:
    file = tmp_path / "rows.json"
    done = run_ident(tmp_path, "--quick", "--json", str(file))
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


@pytest.mark.exhaustive
def test_bench_ident___stability___no_model_of_any_noise_is_unstable(tmp_path: Path) -> None:
    file = tmp_path / "counts.json"
    done = run_ident(tmp_path, "--stability", "3", "--json", str(file))
    assert done.returncode == 0, done.stderr
    counts = json.loads(file.read_text("utf-8"))
    methods, noises = ("orse", "orse_iv", "auto"), ("white", "butterworth", "ar1", "closed_loop")
    assert [(each["noise"], each["method"]) for each in counts] == [
        (noise, method) for noise in noises for method in methods
    ]
    assert {each["seeds"] for each in counts} == {3}
    # The matrices as estimated; the policy has nothing to do.
    assert {each["unstable"] for each in counts} == {0}
    assert {each["after_policy"] for each in counts} == {0}


def test_bench_ident___unknown_option___fails() -> None:
    result = CliRunner().invoke(main, ["--fast"])
    assert result.exit_code == 2
    assert "No such option" in result.output
