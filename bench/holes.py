"""Benchmark of records with holes: what is lost of a model when samples are lost of its record.

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
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
import control
import numpy as np
from ident import interpreters
from ident_plant import trial as synthetic_trial
from rich.console import Console
from rich.progress import track
from rich.table import Table

from flexarm_bags.reader import Recorded
from flexarm_control.laws.registry import build_law
from flexarm_control.references import build_reference
from flexarm_control.simulation import simulate
from flexarm_core.errors import IdentificationError
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident import IoData, identify, preprocess, validate_dmv
from flexarm_ident.reading.alignment import arm_reading
from flexarm_ident.records.iodata import ARM_OUTPUTS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from flexarm_daq.rigs.rig_protocol import RigSample

    Array = NDArray[np.float64]
    Damage = Callable[["Run", np.random.Generator], "Run"]

EXPERIMENT = "C_dat3"
RATE_HZ = 300.0
REPLY_S = 6e-4
BASELINE = "ctrlsys"
BASELINE_ORDER, BLOCK_ROWS = 10, 40
_START_NS = 1_700_000_000_000_000_000
_LINEAR_SAMPLES = 6000
_WORKER = Path(__file__).with_name("ident_worker.py")


@dataclass(frozen=True)
class Run:
    """What a recorder has of a run: samples and the commands that answer them."""

    sequence: NDArray[np.int64]
    time_s: Array
    y: Array
    in_force: Array
    in_force_sequence: NDArray[np.int64]
    answers: Array
    answer_sequence: NDArray[np.int64]
    answered: NDArray[np.int64]

    def without(self, lost: NDArray[np.bool_], *, numbered: bool, answers: bool = False) -> Run:
        """Return the run without some samples, by numbers that tell or that do not."""
        kept = ~lost
        sequence = self.sequence[kept] if numbered else np.arange(1, kept.sum() + 1)
        told = (
            np.ones(len(self.answered), dtype=np.bool_) if answers else kept[: len(self.answered)]
        )
        answered = (
            self.answered[told]
            if numbered
            else np.searchsorted(np.flatnonzero(kept), np.flatnonzero(told), side="right")
        )
        return replace(
            self,
            sequence=sequence,
            time_s=self.time_s[kept],
            y=self.y[kept],
            in_force=self.in_force[kept],
            in_force_sequence=self.in_force_sequence[kept],
            answers=self.answers[told],
            answer_sequence=self.answer_sequence[told],
            answered=answered,
        )


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


class _Timed:
    """The simulated rig with samples at given instants, and each command a while after."""

    def __init__(self, instants: Array, seed: int) -> None:
        self._instants_s = [*instants.tolist(), np.inf]
        self._next = 0
        self._now_s = 0.0
        self._rig = SimulatedRig(
            RigParameters(), rate_hz=RATE_HZ, seed=seed, clock=lambda: self._now_s
        )

    def open(self) -> None:
        """Start at rest."""
        self._rig.open()

    def read(self) -> RigSample:
        """Sample at the next instant."""
        self._now_s = self._instants_s[self._next]
        self._next += 1
        return self._rig.read()

    def write(self, command_v: float) -> None:
        """Command the drive `REPLY_S` later, before the next sample."""
        self._now_s = min(self._now_s + REPLY_S, self._instants_s[self._next])
        self._rig.write(command_v)


def simulated(seed: int, jitter: float = 0.0) -> Run:
    """Run the experiment, with samples whose instants scatter by a part of the period."""
    entry = experiment(EXPERIMENT)
    law = build_law(entry.law, entry.gains)
    reference = build_reference(entry.reference, {**dict(entry.profile), "seed": seed})
    rng = np.random.default_rng(seed)
    instants = np.arange(entry.samples) / RATE_HZ
    if jitter:
        instants += np.clip(rng.normal(0.0, jitter, entry.samples), -0.9, 0.9) / RATE_HZ
        instants = np.sort(instants - instants.min())
    reference_v = np.array([reference(instant_s) for instant_s in instants.tolist()])
    run = simulate(_Timed(instants, seed), law, reference_v)
    answers = np.column_stack([run.effort, run.compensation])
    in_force = np.vstack([np.zeros(2), answers[:-1]])
    numbers = np.arange(1, entry.samples + 1)
    in_force[:, 0] += in_force[:, 1]
    answers[:, 0] += answers[:, 1]
    return Run(numbers, instants, run.y, in_force, numbers - 1, answers, numbers, numbers)


def single(share: float, *, numbered: bool, answers: bool = False) -> Damage:
    """Lose single samples at random."""

    def damage(run: Run, rng: np.random.Generator) -> Run:
        lost = rng.random(len(run.sequence)) < share
        lost[[0, -1]] = False
        return run.without(lost, numbered=numbered, answers=answers)

    return damage


def bursts(share: float, *, numbered: bool) -> Damage:
    """Lose bursts of 5 to 80 samples."""

    def damage(run: Run, rng: np.random.Generator) -> Run:
        lost = np.zeros(len(run.sequence), dtype=np.bool_)
        while lost.mean() < share:
            start = rng.integers(1, len(lost) - 81)
            lost[start : start + rng.integers(5, 81)] = True
        return run.without(lost, numbered=numbered)

    return damage


def one_channel(share: float) -> Damage:
    """Lose one gauge at random instants."""

    def damage(run: Run, rng: np.random.Generator) -> Run:
        y = run.y.copy()
        y[rng.random(len(y)) < share, 1] = np.nan
        return replace(run, y=y)

    return damage


def half_rate(run: Run, _: np.random.Generator) -> Run:
    """Have one gauge at half the rate."""
    y = run.y.copy()
    y[1::2, 2] = np.nan
    return replace(run, y=y)


DAMAGES: dict[str, Damage] = {
    "none": lambda run, _: run,
    "0.5 % single, numbered": single(0.005, numbered=True),
    "0.5 % single, stamps": single(0.005, numbered=False),
    "2 % single, numbered": single(0.02, numbered=True),
    "2 % single, stamps": single(0.02, numbered=False),
    "5 % single, numbered": single(0.05, numbered=True),
    "5 % single, stamps": single(0.05, numbered=False),
    "10 % single, numbered": single(0.10, numbered=True),
    "10 % single, stamps": single(0.10, numbered=False),
    "10 % single, with commands": single(0.10, numbered=True, answers=True),
    "10 % bursts, numbered": bursts(0.10, numbered=True),
    "10 % bursts, stamps": bursts(0.10, numbered=False),
    "20 % bursts, numbered": bursts(0.20, numbered=True),
    "20 % bursts, stamps": bursts(0.20, numbered=False),
    "10 % of one gauge": one_channel(0.10),
    "one gauge at half rate": half_rate,
}
LINEAR = "linear arm: "
LINEAR_DAMAGES: dict[str, Damage] = {
    LINEAR + name: DAMAGES[name]
    for name in ("none", "10 % single, numbered", "10 % bursts, numbered", "20 % bursts, numbered")
}
JITTER = "instants, 0.3 periods RMS"
_JITTER = 0.3


def read(run: Run, name: str) -> IoData:
    """Read a run as the reader of bags does."""
    stamps_ns = _START_NS + np.rint(run.time_s * 1e9).astype(np.int64)
    stamp = {"header.stamp.sec": stamps_ns // 10**9, "header.stamp.nanosec": stamps_ns % 10**9}
    state = Recorded(
        stamps_ns,
        {
            **stamp,
            "sequence": run.sequence,
            **dict(zip(ARM_OUTPUTS, run.y.T, strict=True)),
            "command_v": run.in_force[:, 0],
            "compensation_v": run.in_force[:, 1],
            "command_sequence": run.in_force_sequence,
        },
    )
    after_ns = np.interp(run.answered, run.sequence, stamps_ns - _START_NS) + REPLY_S * 1e9
    sent_ns = _START_NS + after_ns.astype(np.int64)
    commands = Recorded(
        sent_ns,
        {
            "header.stamp.sec": sent_ns // 10**9,
            "header.stamp.nanosec": sent_ns % 10**9,
            "sequence": run.answer_sequence,
            "state_sequence": run.answered,
            "effort_v": run.answers[:, 0] - run.answers[:, 1],
            "compensation_v": run.answers[:, 1],
        },
    )
    return arm_reading(state, None, lambda: [commands], declared=[True], source=name).data


def linear_trials(case: tuple[int, tuple[str, ...], str | None]) -> list[Trial]:
    """Damage the record of a linear arm of one seed in some ways."""
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
        model = identify(damaged, order=BASELINE_ORDER, method="auto").model
        error = validate_dmv(model, fresh).mean
        beside = None if python is None else baseline(damaged, fresh, python)
        found.append(Trial(name, seed, BASELINE_ORDER, (np.nan,) * 3, error, beside))
    return found


def trials(case: tuple[int, tuple[str, ...], str | None]) -> list[Trial]:
    """Damage the record of one seed in every way."""
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
@click.option("--seeds", type=click.IntRange(1), default=20, show_default=True)
@click.option("--first-seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--only", multiple=True, help="Damages whose names contain this.")
@click.option("--json", "json_file", type=click.Path(dir_okay=False, path_type=Path))
def main(*, seeds: int, first_seed: int, only: tuple[str, ...], json_file: Path | None) -> None:
    """Damage the records, print one table, and write the trials to a file on request."""
    names = ("none", *(n for n in (*DAMAGES, JITTER) if n != "none" and _wanted(n, only)))
    python = interpreters().get(BASELINE)
    cases = [(seed, names, python) for seed in range(first_seed, first_seed + seeds)]
    with ProcessPoolExecutor(2) as pool:
        found = [each for part in track(pool.map(trials, cases), total=len(cases)) for each in part]
        linear = [(seed, tuple(LINEAR_DAMAGES), python) for seed, _, _ in cases]
        beside = [each for part in pool.map(linear_trials, linear) for each in part]
    console = Console(width=120)
    console.print(table(found, names))
    console.print(table(beside, tuple(LINEAR_DAMAGES)))
    found += beside
    if python is None:
        console.print(f"{BASELINE} is not installed: `bench ident --install-peers` gets it")
    if json_file:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(json.dumps([asdict(each) for each in found], indent=1))


def _wanted(name: str, only: tuple[str, ...]) -> bool:
    return not only or any(part in name for part in only)


def table(found: list[Trial], names: tuple[str, ...]) -> Table:
    """Medians over the seeds; ratios to the undamaged record's error of the same seed."""
    result = Table(title="Models of damaged records, medians, judged undamaged", box=None)
    result.add_column("damage", no_wrap=True)
    for heading in (
        "order",
        "f1 %",
        "f2 %",
        "f3 %",
        "error",
        "ratio",
        "worst",
        BASELINE,
        "refused",
    ):
        result.add_column(heading, justify="right", no_wrap=True)
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
