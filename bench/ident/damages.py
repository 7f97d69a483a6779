"""Records of the benchmark of holes: a simulated run, and the ways to damage it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.reader import Recorded
from flexarm_control.laws.registry import build_law
from flexarm_control.references import build_reference
from flexarm_control.simulation import simulate
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.reading.alignment import arm_alignment
from flexarm_ident.records.iodata import ARM_OUTPUTS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from flexarm_daq.rigs.rig_protocol import RigSample
    from flexarm_ident import IoData

    Array = NDArray[np.float64]
    Damage = Callable[["Run", np.random.Generator], "Run"]

EXPERIMENT = "C_dat3"
RATE_HZ = 300.0
REPLY_S = 6e-4
_START_NS = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class Run:
    """Recorded run: samples and the commands that answer them."""

    sequence: NDArray[np.int64]
    time_s: Array
    y: Array
    in_force: Array
    in_force_sequence: NDArray[np.int64]
    answers: Array
    answer_sequence: NDArray[np.int64]
    answered: NDArray[np.int64]

    def without(self, lost: NDArray[np.bool_], *, numbered: bool, answers: bool = False) -> Run:
        """Return the run without some samples; `numbered` keeps the gaps in their numbers."""
        kept = ~lost
        sequence = self.sequence[kept] if numbered else np.arange(1, kept.sum() + 1)
        has_answer = (
            np.ones(len(self.answered), dtype=np.bool_) if answers else kept[: len(self.answered)]
        )
        answered = (
            self.answered[has_answer]
            if numbered
            else np.searchsorted(np.flatnonzero(kept), np.flatnonzero(has_answer), side="right")
        )
        return replace(
            self,
            sequence=sequence,
            time_s=self.time_s[kept],
            y=self.y[kept],
            in_force=self.in_force[kept],
            in_force_sequence=self.in_force_sequence[kept],
            answers=self.answers[has_answer],
            answer_sequence=self.answer_sequence[has_answer],
            answered=answered,
        )


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

    def write(self, commands: Sequence[float]) -> None:
        """Command the drive `REPLY_S` later, before the next sample."""
        self._now_s = min(self._now_s + REPLY_S, self._instants_s[self._next])
        self._rig.write(commands)


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
    aligned = arm_alignment(lambda: [state], lambda: [commands], source=name)
    return aligned.reading(state, declared=[True]).data
