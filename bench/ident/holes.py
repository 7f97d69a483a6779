"""Benchmark of records with holes: errors of models when samples of their record are lost.

A closed-loop record like C_dat3 is simulated for each seed, damaged in the ways that recorders and
busy machines know, read as a bag would be, and identified on its first half with the defaults. The
model is judged on the undamaged record (DMV, free simulation). The named baseline beside it fills
every hole by a straight line and takes SLICOT's N4SID of order 10 (`bench ident --install-peers`).

Most of that error is friction, which no linear model has. What the holes alone cost shows on a
linear arm with white noise, the synthetic one of `bench ident`, judged on a fresh input.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import click
import control
import numpy as np

from bench.ident.damages import DAMAGES, RATE_HZ, Run, read, simulated
from bench.ident.ident import interpreters
from bench.ident.plant import trial as synthetic_trial
from bench.tools import (
    count_option,
    first_seed_option,
    json_option,
    make_table,
    run_trials,
    write_json,
)
from flexarm_bringup.console import terminal
from flexarm_core.errors import IdentificationError
from flexarm_daq import RigParameters
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident import IoData, identify, preprocess, validate_dmv

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rich.table import Table

    from bench.ident.damages import Damage

    Array = NDArray[np.float64]

BASELINE = "ctrlsys"
BASELINE_ORDER, BLOCK_ROWS = 10, 40
_LINEAR_SAMPLES = 6000
_WORKER = Path(__file__).with_name("worker.py")


@dataclass(frozen=True)
class Trial:
    """One record with one damage; errors are mean DMV on the undamaged record."""

    damage: str
    seed: int
    order: int
    mode_errors: tuple[float, ...]
    error: float
    baseline: float | None
    refused: str = ""


JITTER = "instants, 0.3 periods RMS"
_JITTER = 0.3
LINEAR = "linear arm: "
LINEAR_DAMAGES: dict[str, Damage] = {
    LINEAR + name: DAMAGES[name]
    for name in ("none", "10 % single, numbered", "10 % bursts, numbered", "20 % bursts, numbered")
}


def linear_trials(case: tuple[int, tuple[str, ...], str | None]) -> list[Trial]:
    """Identify damaged records of a linear arm, of one seed."""
    seed, names, python = case
    made = synthetic_trial(_LINEAR_SAMPLES, "white", seed)
    outputs = tuple(f"y{channel}" for channel in range(made.y.shape[1]))

    def record(u: Array, y: Array) -> IoData:
        return IoData(u, y, dt_s=1.0 / RATE_HZ, inputs=("u",), outputs=outputs)

    fresh = record(made.fresh_u, made.truth)
    numbers = np.arange(1, _LINEAR_SAMPLES + 1)
    still = np.zeros((_LINEAR_SAMPLES, 2))
    whole = Run(numbers, numbers / RATE_HZ, made.y, still, numbers - 1, still, numbers, numbers)
    found = []
    for name in names:
        rng = np.random.default_rng([seed, *name.encode()])
        kept = LINEAR_DAMAGES[name](whole, rng).sequence - 1
        y = np.full(made.y.shape, np.nan)
        y[kept] = made.y[kept]
        damaged = record(made.u, y)
        model = identify(damaged, order=BASELINE_ORDER, feedthrough=False).model
        error = validate_dmv(model, fresh).mean
        beside = None if python is None else baseline(damaged, fresh, python)
        found.append(Trial(name, seed, BASELINE_ORDER, (np.nan,) * 3, error, beside))
    return found


def trials(case: tuple[int, tuple[str, ...], str | None]) -> list[Trial]:
    """Identify damaged records of the simulated rig, of one seed."""
    seed, names, python = case
    whole = simulated(seed)
    undamaged = preprocess(read(whole, "undamaged"))
    found = []
    for name in names:
        rng = np.random.default_rng([seed, *name.encode()])
        run = simulated(seed, _JITTER) if name == JITTER else DAMAGES[name](whole, rng)
        found.append(trial(name, seed, run, undamaged, python))
    return found


def trial(name: str, seed: int, run: Run, undamaged: IoData, python: str | None) -> Trial:
    """Identify a damaged record and judge the model on the undamaged one."""
    true_hz = natural_frequencies_hz(RigParameters())[:3]
    try:
        record = preprocess(read(run, name))
        model = identify(record.head(len(record) // 2), method="auto")
    except IdentificationError as error:
        return Trial(name, seed, 0, (), float("inf"), None, str(error))
    modes_hz = np.array([mode.frequency_hz for mode in model.modes if mode.is_pair] or [np.nan])
    nearest = [modes_hz[np.nanargmin(np.abs(np.log(modes_hz / hz)))] / hz - 1.0 for hz in true_hz]
    return Trial(
        name,
        seed,
        model.order,
        tuple(float(each) for each in nearest),
        validate_dmv(model.model, undamaged).mean,
        None if python is None else baseline(record.head(len(record) // 2), undamaged, python),
    )


def baseline(record: IoData, undamaged: IoData, python: str) -> float:
    """Return the error of SLICOT's model of the record with straight lines in its holes."""
    y = record.y_measured.copy()
    rows = np.arange(len(y))
    for column in y.T:
        known = ~np.isnan(column)
        column[:] = np.interp(rows, rows[known], column[known])
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder, "u.npy"), record.u)
        np.save(Path(folder, "y.npy"), y)
        order, block_rows = str(BASELINE_ORDER), str(BLOCK_ROWS)
        done = subprocess.run(  # noqa: S603 - our own worker
            [python, str(_WORKER), BASELINE, folder, order, block_rows],
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode != 0:
        return float("inf")
    A, B, C, D = (np.array(part) for part in json.loads(done.stdout)["model"][:4])
    try:
        return validate_dmv(control.ss(A, B, C, D, record.dt_s), undamaged).mean
    except IdentificationError:
        return float("inf")


@click.command()
@count_option("--seeds", 20)
@first_seed_option
@click.option("--only", multiple=True, help="Damages whose names contain this.")
@json_option
def main(*, seeds: int, first_seed: int, only: tuple[str, ...], json_file: Path | None) -> None:
    """Damage the records, print one table, and write the trials to a file on request."""
    names = ("none", *(n for n in (*DAMAGES, JITTER) if n != "none" and _wanted(n, only)))
    python = interpreters().get(BASELINE)
    cases = [(seed, names, python) for seed in range(first_seed, first_seed + seeds)]
    found = list(chain.from_iterable(run_trials(trials, cases)))
    linear = [(seed, tuple(LINEAR_DAMAGES), python) for seed, _, _ in cases]
    beside = list(chain.from_iterable(run_trials(linear_trials, linear)))
    terminal.show_table(table(found, names))
    terminal.show_table(table(beside, tuple(LINEAR_DAMAGES)))
    found += beside
    if python is None:
        terminal.CONSOLE.print(
            f"{BASELINE} is not installed: `bench ident --install-peers` gets it"
        )
    write_json(json_file, found)


def _wanted(name: str, only: tuple[str, ...]) -> bool:
    return not only or any(part in name for part in only)


def table(found: list[Trial], names: tuple[str, ...]) -> Table:
    """Return medians over the seeds, and ratios to the same seed's undamaged record."""
    heads = ("damage", "order", "f1 %", "f2 %", "f3 %", "error", "ratio", "worst", BASELINE)
    title = "Models of damaged records, medians, judged undamaged"
    result = make_table(*heads, "refused", title=title)
    whole = {each.seed: each.error for each in found if each.damage == names[0]}
    for name in names:
        mine = [each for each in found if each.damage == name]
        good = [each for each in mine if not each.refused]
        ratios = [each.error / whole[each.seed] for each in good]
        modes = np.median(np.abs([each.mode_errors for each in good]), axis=0)
        beside = [each.baseline / each.error for each in good if each.baseline is not None]
        result.add_row(
            name,
            "{:.0f} to {:.0f}".format(*np.percentile([each.order for each in good], [10, 90])),
            *("-" if np.isnan(mode) else f"{100.0 * mode:.1f}" for mode in modes),
            f"{np.median([each.error for each in good]):.3g}",
            f"{np.median(ratios):.3f}",
            f"{max(ratios):.3f}",
            f"{np.median(beside):.1f}" if beside else "-",
            str(len(mine) - len(good)),
        )
    return result


if __name__ == "__main__":
    main()
