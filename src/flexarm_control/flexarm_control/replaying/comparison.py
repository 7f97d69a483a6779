"""Comparison of recorded commands with those of the recorded law on the recorded samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import ASKED, Handover
from flexarm_control.loop_setup import Setup
from flexarm_control.models.chosen_model import PREFIX
from flexarm_control.replaying.record import NOT_RECORDED
from flexarm_control.rig_setup import REFERENCES, RIG, recorded_setup
from flexarm_core.errors import SettingError
from flexarm_core.signals import Sample

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_control.laws.law_protocol import Memory
    from flexarm_control.replaying.record import LawRecord, LoopRecord
    from flexarm_control.rig_setup import RigSetup
    from flexarm_core.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Place:
    """Sample of a record and its answer.

    Attributes
    ----------
    sequence : int
        Number of the sample.
    time_s : float
        Time of the sample since the first one of the record, s.
    command_sequence : int
        Number of the command that answers it.
    """

    sequence: int
    time_s: float
    command_sequence: int


@dataclass(frozen=True)
class Change:
    """Change of a parameter, in force from a place on."""

    place: Place
    text: str


@dataclass(frozen=True)
class Difference:
    """Command that the recorded law does not give on the recorded samples.

    Attributes
    ----------
    place : Place
        Place of the command.
    recorded, recomputed : ndarray, (2,)
        Feedback effort u_e and compensation u_c, V.
    change : Change or None
        Last change of a parameter up to there.
    """

    place: Place
    recorded: FloatArray
    recomputed: FloatArray
    change: Change | None


@dataclass(frozen=True)
class Replay:
    """Outcome of a replay.

    Attributes
    ----------
    samples, commands, compared : int
        Samples and commands in the record, and commands that could be compared. The others come
        before the first law that was published, or after a sample or command that is not in the
        record.
    laws : tuple of str
        Laws in the order of their first use.
    changes : tuple of Change
        Changes of parameters.
    differences : tuple of Difference
        Commands that differ by more than the tolerance.
    largest_v : float
        Largest difference of effort or compensation, V, also below the tolerance.
    """

    samples: int
    commands: int
    compared: int
    laws: tuple[str, ...]
    changes: tuple[Change, ...]
    differences: tuple[Difference, ...]
    largest_v: float


def replay(record: LoopRecord, *, tolerance_v: float = 0.0) -> Replay:
    """Run the recorded samples through the recorded law and compare each command.

    Parameters
    ----------
    record : LoopRecord
        The record.
    tolerance_v : float
        Largest difference that counts as none, V; 0 compares every bit.

    Raises
    ------
    SettingError
        When a recorded law cannot be built, or has another memory.
    """
    answers, changed = _answers(record)
    rows = np.flatnonzero(np.isfinite(answers[:, 0]))
    recorded, recomputed = record.answers[rows], answers[rows]
    changes = tuple(Change(_place(record, row), text) for row, text in changed)
    differences = []
    for row in rows[differing(recorded, recomputed, tolerance_v).any(axis=1)].tolist():
        before = sum(at <= row for at, _ in changed)
        change = changes[before - 1] if before else None
        place = _place(record, row)
        differences.append(Difference(place, record.answers[row], answers[row], change))
    apart_v = np.nan_to_num(np.abs(recorded - recomputed), nan=np.inf, posinf=np.inf)
    return Replay(
        samples=len(record.sequence),
        commands=len(record.answers),
        compared=len(rows),
        laws=tuple(dict.fromkeys(law.parameters["law"] for law in record.laws)),
        changes=changes,
        differences=tuple(differences),
        largest_v=float(apart_v.max(initial=0.0)),
    )


def differing(recorded: FloatArray, recomputed: FloatArray, tolerance_v: float) -> BoolArray:
    """Return where two arrays differ by more than a tolerance; 0 compares every bit."""
    differs: BoolArray = recorded.view(np.int64) != recomputed.view(np.int64)
    if tolerance_v > 0.0:
        differs &= ~(np.abs(recorded - recomputed) <= tolerance_v)
    return differs


class _Law:
    """Law and reference from one place of the record on."""

    def __init__(self, recorded: LawRecord, setup: Setup) -> None:
        self.setup = setup
        self._reference_v = recorded.reference_v
        self._run_start_ns = recorded.stamp_ns - recorded.run_time_ns
        self._handover = Handover(setup.law)
        self._hears = ASKED in recorded.memory
        known = dict(self._handover.memory())
        if not self._hears:
            del known[ASKED]
        if _sizes(recorded.memory) != _sizes(known):
            raise SettingError(
                f"the recorded memory of law {setup.law_spec.name} is that of another version"
            )
        self._handover.remember(recorded.memory)

    def answer(
        self, volts: Sequence[float], stamp_ns: int, in_force: Sequence[float]
    ) -> Sequence[float]:
        """Return the answer to a sample, taken while a command was in force."""
        reference_v, drive = self._reference_v, DriveCommand(*in_force)
        if self.setup.profile is not None:
            reference_v = self.setup.profile((stamp_ns - self._run_start_ns) * 1e-9)
        return self._handover.step(volts, reference_v, drive if self._hears else None)


class _RigLaw:
    """Laws and references of any other rig from one place of the record on."""

    def __init__(self, recorded: LawRecord, setup: RigSetup) -> None:
        self.setup = setup
        self._run_start_ns = recorded.stamp_ns - recorded.run_time_ns
        self._loop = setup.loop()
        known = {**self._loop.memory(), REFERENCES: setup.tracks}
        if _sizes(recorded.memory) != {name: len(group) for name, group in known.items()}:
            raise SettingError(f"the recorded memory of law {setup.law} is that of another version")
        self._references = tuple(recorded.memory[REFERENCES])
        self._loop.remember(recorded.memory)

    def answer(
        self, outputs: Sequence[float], stamp_ns: int, in_force: Sequence[float]
    ) -> Sequence[float]:
        """Return the answers to a sample, taken while commands were in force."""
        inputs = len(in_force) // 2
        sample = Sample(
            *(stamp_ns, 0, tuple(outputs)),
            *(tuple(in_force[:inputs]), tuple(in_force[inputs:])),
            command_sequence=0,
        )
        references = self._references
        if self.setup.has_profile:
            references = self.setup.profile((stamp_ns - self._run_start_ns) * 1e-9)
        efforts, compensations = self._loop.step(sample, references)
        return (*efforts, *compensations)


def _answers(record: LoopRecord) -> tuple[FloatArray, list[tuple[int, str]]]:
    """Return the recomputed answers, (commands, 2), and rows and texts of changes of parameters.

    An answer is NaN where the law is not known.
    """
    answers: FloatArray = np.full_like(record.answers, np.nan)
    changes: list[tuple[int, str]] = []
    recorded_at = {(law.stamp_ns, law.command_sequence): law for law in record.laws}
    law: _Law | _RigLaw | None = None
    before: LawRecord | None = None
    last = NOT_RECORDED
    numbers, answered = record.command_sequence.tolist(), record.answered.tolist()
    for row, (number, sample) in enumerate(zip(numbers, answered, strict=True)):
        if sample == NOT_RECORDED or number != last + 1:
            # What the law did in between is not known.
            law = None
        last = number
        if sample == NOT_RECORDED:
            continue
        stamp_ns = int(record.stamps_ns[sample])
        recorded = recorded_at.get((stamp_ns, number))
        if recorded is not None:
            same = before is not None and recorded.parameters == before.parameters
            if before is not None:
                changes += [(row, text) for text in _changes(before, recorded)]
            law = _law_of(recorded, law if same else None)
            before = recorded
        if law is not None:
            in_force = record.drive[sample].tolist()
            answers[row] = law.answer(record.volts[sample].tolist(), stamp_ns, in_force)
    return answers, changes


def _law_of(recorded: LawRecord, same: _Law | _RigLaw | None) -> _Law | _RigLaw:
    """Return the published law; the setup of one with the same parameters is built already."""
    if RIG not in recorded.parameters:
        setup = same.setup if isinstance(same, _Law) else Setup.of(recorded.parameters)
        return _Law(recorded, setup)
    rig_setup = same.setup if isinstance(same, _RigLaw) else recorded_setup(recorded.parameters)
    return _RigLaw(recorded, rig_setup)


def _changes(before: LawRecord, after: LawRecord) -> Iterator[str]:
    """Yield the parameters of both that differ; another law is named instead."""
    for name, value in after.parameters.items():
        old = before.parameters.get(name, value)
        if old != value:
            is_entry = name.startswith(PREFIX)
            yield f"{name} was replaced" if is_entry else f"{name} {_shown(old)} to {_shown(value)}"


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else f"{value}"


def _sizes(memory: Memory) -> dict[str, int]:
    return {name: len(group) for name, group in memory.items()}


def _place(record: LoopRecord, row: int) -> Place:
    sample = record.answered[row]
    return Place(
        sequence=int(record.sequence[sample]),
        time_s=float(record.stamps_ns[sample] - record.stamps_ns[0]) * 1e-9,
        command_sequence=int(record.command_sequence[row]),
    )
