"""Benchmark of the identification: CPU time, memory and accuracy beside its peers.

A synthetic arm of order 10 (1 input, 4 outputs, 300 Hz) is identified with order 18 and 40 block
rows, on one BLAS thread. Every measurement runs in a process of its own. A peer that is not
installed is named in the table. The error is the geometric mean, over outputs and seeds, of the
relative simulation error on a fresh input without noise.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from scipy import io

from bench.ident.plant import NOISES, error, trial
from bench.ident.stability import counted
from bench.tools import count_option, first_seed_option, json_option, make_table, write_json
from flexarm_bringup.console import terminal

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.table import Table

    from bench.ident.plant import Trial
    from bench.ident.stability import Count

ORDER, BLOCK_ROWS = 18, 40
OURS = ("orse", "orse_iv", "auto")
BASELINE = "ctrlsys"
# Import name of each peer, and its distribution.
PEERS = {
    "ctrlsys": ("ctrlsys", "ctrlsys"),
    "sippy": ("sippy_unipi", "sippy-unipi"),
    "mdof": ("mdof", "mdof"),
}
_HERE = Path(__file__).parent
_LENGTHS, _QUICK_LENGTHS = (6_000, 60_000, 600_000), (2_000,)
# A, B, C, D; ours adds the number of eigenvalues that were moved.
_MATRICES = 4
# More than this takes these peers minutes and many gigabytes: one record, white noise.
_SLOW, _SLOW_LENGTH = ("sippy", "octave"), 60_000


@dataclass(frozen=True)
class Row:
    """Result of one method for one kind of noise and one length.

    `cpu_s` and `memory_mb` are medians over the seeds; `error` is None for a method that gives no
    B, `unstable` counts matrices A as estimated, before any policy, with an eigenvalue outside the
    unit circle. `seeds` counts the runs that ended well; `failure` is what the last other one said.
    """

    method: str
    noise: str
    k: int
    seeds: int
    cpu_s: float | None = None
    memory_mb: float | None = None
    error: float | None = None
    unstable: int | None = None
    failure: str | None = None


@click.command()
@click.option("--quick", is_flag=True, help="2000 samples, white noise, our own default only.")
@count_option("--seeds", 3)
@first_seed_option
@click.option(
    "--stability",
    type=click.IntRange(1),
    metavar="SEEDS",
    help="Only count unstable models of ours over as many seeds.",
)
@json_option
@click.option("--install-peers", is_flag=True, help="Install the peers from PyPI first.")
def main(
    *,
    quick: bool,
    seeds: int,
    first_seed: int,
    stability: int | None,
    json_file: Path | None,
    install_peers: bool,
) -> None:
    """Measure, print one table, and write its rows to a file on request."""
    if stability is not None:
        seeds_used = range(first_seed, first_seed + stability)
        counts = list(counted(OURS, _LENGTHS[0], seeds_used, order=ORDER, block_rows=BLOCK_ROWS))
        terminal.show_table(stability_table(counts))
        write_json(json_file, counts)
        return
    if install_peers:
        install()
    pythons = interpreters()
    missing = [name for name in PEERS if name not in pythons]
    if not shutil.which("octave"):
        missing.append("octave (Debian: octave-control)")
    methods = [*OURS[:1]] if quick else [*OURS, *pythons, *(["octave"] if has_octave() else [])]
    rows: list[Row] = []
    for row in swept(methods, range(first_seed, first_seed + (1 if quick else seeds)), quick=quick):
        rows.append(row)
        terminal.CONSOLE.print(
            f"{row.noise} {row.k} {row.method}: {row.failure or row.error}", style="dim"
        )
        # A run that is ended early leaves what it measured.
        write_json(json_file, rows)
    terminal.show_table(table(rows))
    if not quick:
        terminal.CONSOLE.print(
            f"{' and '.join(_SLOW)}: more than {_SLOW_LENGTH} samples once, white noise"
        )
    if missing:
        terminal.CONSOLE.print(
            f"not installed: {', '.join(missing)}; --install-peers gets those of PyPI"
        )


def cache() -> Path:
    """Return the folder of the peers' environments."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "flexarm" / "peers"


def install(names: Sequence[str] = tuple(PEERS)) -> None:
    """Install peers of `requirements/peers.in`, each into an environment of its own."""
    lines = (_HERE.parents[1] / "requirements" / "peers.in").read_text("utf-8").splitlines()
    wanted = [line.partition("#")[0].strip() for line in lines]
    for name in names:
        distribution = PEERS[name][1]
        requirement = next(line for line in wanted if line.startswith(distribution))
        folder = cache() / name
        terminal.CONSOLE.print(f"installing {requirement} into {folder}")
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)  # noqa: S603
        pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", requirement]
        if subprocess.run(pip, check=False).returncode != 0:  # noqa: S603 - a line of our own file
            terminal.CONSOLE.print(f"{distribution} could not be installed", style="bold red")


def interpreters() -> dict[str, str]:
    """Return the Python of each installed peer: of its own environment, else this one."""
    found = {}
    for name, (module, _) in PEERS.items():
        for python in (str(cache() / name / "bin" / "python"), sys.executable):
            probe = (
                f"from importlib.util import find_spec as f; raise SystemExit(not f({module!r}))"
            )
            command = [python, "-c", probe]
            if (
                Path(python).exists() and subprocess.run(command, check=False).returncode == 0  # noqa: S603
            ):
                found[name] = python
                break
    return found


def has_octave() -> bool:
    """Say whether octave and its control package are there."""
    octave = shutil.which("octave")
    if octave is None:
        return False
    command = [octave, "--quiet", "--eval", "pkg load control"]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0  # noqa: S603


def swept(methods: Sequence[str], seeds: Sequence[int], *, quick: bool) -> Iterator[Row]:
    """Measure all kinds of noise and lengths, or one of each, and yield a row for each method."""
    for noise in NOISES[:1] if quick else NOISES:
        for k in _QUICK_LENGTHS if quick else _LENGTHS:
            too_long = k > _SLOW_LENGTH and noise != NOISES[0]
            some = [each for each in methods if not (too_long and each in _SLOW)]
            yield from measured(some, noise, k, seeds)


def measured(methods: Sequence[str], noise: str, k: int, seeds: Sequence[int]) -> Iterator[Row]:
    """Measure all methods on the same records and yield a row for each."""
    pythons = interpreters()
    results: dict[str, list[dict[str, Any]]] = {method: [] for method in methods}
    failures: dict[str, str] = {}
    for seed in seeds:
        given = trial(k, noise, seed)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            np.save(folder / "u.npy", given.u)
            np.save(folder / "y.npy", given.y)
            for method in methods:
                if method in _SLOW and k > _SLOW_LENGTH and seed > seeds[0]:
                    continue
                answer = run_worker(method, folder, pythons)
                if isinstance(answer, str):
                    failures[method] = answer
                else:
                    results[method].append(_judged(answer, given))
    for method in methods:
        found = results[method]
        if not found:
            yield Row(method, noise, k, 0, failure=failures[method])
            continue
        errors = [each["error"] for each in found if each["error"] is not None]
        yield Row(
            method,
            noise,
            k,
            len(found),
            float(np.median([each["cpu_s"] for each in found])),
            float(np.median([each["memory_mb"] for each in found])),
            float(np.exp(np.mean(np.log(errors)))) if errors else None,
            sum(each["unstable"] for each in found),
            failures.get(method),
        )


def table(rows: Sequence[Row]) -> Table:
    """Return the rows beside their ratios to the baseline: of ctrlsys, or of our default."""
    baselines = {(r.noise, r.k): r for r in rows if r.method == OURS[0]}
    name = OURS[0]
    if any(row.method == BASELINE and row.cpu_s for row in rows):
        name = BASELINE
        baselines = {(r.noise, r.k): r for r in rows if r.method == BASELINE}
    heads = ("noise", "method", "K", "CPU s", "MB above data", "error", "unstable", "seeds")
    title = f"order {ORDER}, {BLOCK_ROWS} block rows; in brackets: times {name}"
    shown = make_table(*heads, title=title, words=2)
    for row in rows:
        base = baselines.get((row.noise, row.k))
        if row.cpu_s is None:
            shown.add_row(row.noise, row.method, str(row.k), row.failure)
            continue
        shown.add_row(
            row.noise,
            row.method,
            str(row.k),
            _with_ratio(row.cpu_s, base.cpu_s if base else None, ".4f"),
            f"{row.memory_mb:.0f}",
            _with_ratio(row.error, base.error if base else None, ".6f"),
            str(row.unstable),
            str(row.seeds) + (" (others failed)" if row.failure else ""),
        )
    return shown


def stability_table(counts: Sequence[Count]) -> Table:
    """Return how many models are unstable, before and after the policy."""
    heads = ("noise", "method", "K", "seeds", "as estimated", "after the policy")
    shown = make_table(*heads, title=f"unstable models of order {ORDER}", words=2)
    for each in counts:
        figures = (each.seeds, each.unstable, each.after_policy)
        shown.add_row(each.noise, each.method, str(each.k), *map(str, figures))
    return shown


def _with_ratio(value: float | None, base: float | None, form: str) -> str:
    if value is None:
        return "-"
    return f"{value:{form}}" + (f" ({value / base:.2f})" if base else "")


def _judged(answer: dict[str, Any], given: Trial) -> dict[str, Any]:
    A = np.array(answer["model"][0])
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    judged = None
    if answer["model"][1] is not None:
        B, C, D = (np.array(part) for part in answer["model"][1:4])
        states, inputs, outputs = len(A), given.u.shape[1], given.y.shape[1]
        # Octave writes a matrix of one column as a list.
        B, C, D = B.reshape(states, inputs), C.reshape(outputs, states), D.reshape(outputs, inputs)
        judged = error((A, B, C, D), given)
    moved = len(answer["model"]) > _MATRICES and answer["model"][_MATRICES] > 0
    return {**answer, "error": judged, "unstable": int(radius > 1.0 or moved)}


def run_worker(
    method: str,
    folder: Path,
    pythons: dict[str, str],
    order: int = ORDER,
    block_rows: int = BLOCK_ROWS,
) -> dict[str, Any] | str:
    """Return a worker's answer, or its last words; with order 0 a peer chooses its own."""
    options = [str(folder), str(order), str(block_rows)]
    if method == "octave":
        data = {name: np.load(folder / f"{name}.npy") for name in ("u", "y")}
        io.savemat(folder / "data.mat", data)
        command = ["octave", "--quiet", "--no-gui", str(_HERE / "octave.m"), *options]
    else:
        command = [pythons.get(method, sys.executable), str(_HERE / "worker.py"), method]
        command += options
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(  # noqa: S603 - the workers beside this file
        command, capture_output=True, text=True, check=False, env=environment
    )
    if done.returncode != 0:
        return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    answer: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return answer


if __name__ == "__main__":
    main()
