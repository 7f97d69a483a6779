"""Record of a controlled run, and its commands beside those of the recorded law."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm_bags.reader import (
    ARM_STATE,
    IO_COMMAND,
    IO_SAMPLE,
    LAW_IN_FORCE,
    MOTOR_COMMAND,
    opened,
    sibling,
)
from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import ASKED, Handover
from flexarm_control.loop_setup import Setup, parameters_in
from flexarm_control.models.arm_model import OUTPUTS
from flexarm_control.models.nominal_models import PREFIX
from flexarm_control.rig_setup import REFERENCES, RIG, recorded_setup
from flexarm_core.errors import BagError, SettingError
from flexarm_core.signals import Sample

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_bags.reader import Bag
    from flexarm_control.laws.law_protocol import Memory
    from flexarm_control.rig_setup import RigSetup
    from flexarm_core.arrays import BoolArray, FloatArray

    Integers = NDArray[np.int64]


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


class _Kind(NamedTuple):
    """Members of the messages of a rig's loop."""

    outputs: tuple[str, ...]
    drive: tuple[str, ...]
    command: str
    command_type: str
    answered: str
    answer: tuple[str, ...]


_KINDS = {
    ARM_STATE: _Kind(
        OUTPUTS,
        DriveCommand._fields,
        *("command", MOTOR_COMMAND, "state_sequence", ("effort_v", "compensation_v")),
    ),
    IO_SAMPLE: _Kind(
        ("outputs",),
        ("inputs", "compensations"),
        *("io_command", IO_COMMAND, "sample_sequence", ("efforts", "compensations")),
    ),
}

NOT_RECORDED = -1
"""Row of a sample that is not in the record."""
_NS = 1_000_000_000


@dataclass(frozen=True)
class LawRecord:
    """Law and reference before one answer, as a controller publishes them.

    Attributes
    ----------
    stamp_ns, run_time_ns : int
        Instant of the sample that is answered, and its time since the first one of the run.
    command_sequence : int
        Number of the answer.
    reference_v : float
        Set-point of the service and the topic, V.
    parameters : mapping of str to value
        Parameters that law and reference are built from.
    memory : Memory
        What the law has in memory.
    """

    stamp_ns: int
    run_time_ns: int
    command_sequence: int
    reference_v: float
    parameters: Mapping[str, Any]
    memory: Memory


@dataclass(frozen=True)
class LoopRecord:
    """Samples and answers of one run or more.

    Attributes
    ----------
    sequence, stamps_ns : ndarray of int, (samples,)
        Numbers and instants of the samples.
    volts : ndarray, (samples, outputs)
        Outputs: of the thesis's arm position, base strain, middle strain and speed, V.
    drive : ndarray, (samples, 2 inputs)
        Commands in force while each sample was taken, and the compensations in them.
    command_sequence : ndarray of int, (commands,)
        Numbers of the answers.
    answered : ndarray of int, (commands,)
        Row of the sample that each command answers, or `NOT_RECORDED`.
    answers : ndarray, (commands, 2 inputs)
        Feedback efforts u_e and compensations u_c.
    laws : tuple of LawRecord
        Laws as they were published.
    """

    sequence: Integers
    stamps_ns: Integers
    volts: FloatArray
    drive: FloatArray
    command_sequence: Integers
    answered: Integers
    answers: FloatArray
    laws: tuple[LawRecord, ...]


def read_loop(path: Path, topic: str | None = None) -> LoopRecord:
    """Read a controlled run from a bag.

    Parameters
    ----------
    path : Path
        Bag.
    topic : str, optional
        Topic of the samples, where several arms are in the bag.

    Raises
    ------
    BagError
        If the bag is damaged, or lacks what a replay needs; the message says what.
    """
    with opened(path) as bag:
        topic = bag.choose(topic)
        kind = None if topic is None else _KINDS.get(bag.types[topic])
        if topic is None or kind is None:
            raise BagError(
                "has no samples of flexarm's rig (ArmState, IoSample): nothing to replay"
            )
        command, law = sibling(topic, kind.command), sibling(topic, "law")
        if not bag.has(command, kind.command_type):
            raise BagError(f"has no commands ({command}): record them with the samples")
        if not bag.has(law, LAW_IN_FORCE):
            raise BagError(_without_law(bag, topic, law))
        states, commands = bag.recorded(topic), bag.recorded(command)
        try:
            laws = tuple(map(_law_record, bag.messages(law, LAW_IN_FORCE)))
        except SettingError as error:
            raise BagError(f"{law}: {error}") from error
        sequence = states.integer("sequence")
        return LoopRecord(
            sequence,
            states.stamps_ns(),
            np.column_stack([states.real(name) for name in kind.outputs]),
            np.column_stack([states.real(name) for name in kind.drive]),
            commands.integer("sequence"),
            answered_rows(
                (sequence, states.log_times_ns),
                (commands.integer(kind.answered), commands.log_times_ns),
            ),
            np.column_stack([commands.real(name) for name in kind.answer]),
            laws,
        )


def answered_rows(
    samples: tuple[Integers, Integers], answers: tuple[Integers, Integers]
) -> Integers:
    """Return the row of the sample that each command answers, (commands,).

    Numbers are given anew in each run: of several samples with the number, a command answers the
    last one sent before it. A controller goes forward only.

    Parameters
    ----------
    samples : tuple of ndarray of int, (samples,)
        Numbers of the samples and instants of sending.
    answers : tuple of ndarray of int, (commands,)
        Numbers of the samples that the commands answer, and instants of sending.
    """
    rows = defaultdict(list)
    for row, number in enumerate(samples[0].tolist()):
        rows[number].append(row)
    sent_ns = samples[1].tolist()
    found, last = [], NOT_RECORDED
    for number, command_ns in zip(*(each.tolist() for each in answers), strict=True):
        known = rows.get(number, [])
        before = bisect_right(known, command_ns, key=sent_ns.__getitem__)
        row = known[max(before - 1, 0)] if known else NOT_RECORDED
        found.append(row if row > last else NOT_RECORDED)
        last = max(last, row)
    return np.array(found, dtype=np.int64)


def _without_law(bag: Bag, topic: str, law: str) -> str:
    """Return why a bag has no law."""
    declared = bag.declared_loops(topic)
    if declared and not any(declared):
        return "was recorded in open loop: no controller made its commands"
    return (
        f"has no law ({law}): it was recorded by an older version or without this topic, "
        "record it anew"
    )


def _law_record(message: Any) -> LawRecord:  # noqa: ANN401 - a message of the bag's own type
    """Return a law from its message; SettingError when it does not fit together."""
    stamp, sizes = message.header.stamp, message.memory_sizes.tolist()
    ends = list(accumulate(sizes, initial=0))
    if len(message.memory_names) != len(sizes) or len(message.memory) != ends[-1]:
        raise SettingError("the memory of the law is not as long as its names and sizes say")
    if not np.isfinite(message.memory).all():
        raise SettingError("the memory of the law has a number that is not finite")
    groups = (message.memory[begin:end].tolist() for begin, end in pairwise(ends))
    return LawRecord(
        stamp_ns=int(stamp.sec) * _NS + int(stamp.nanosec),
        run_time_ns=int(message.run_time_ns),
        command_sequence=int(message.command_sequence),
        reference_v=float(message.reference_v),
        parameters=parameters_in(message.parameters),
        memory=dict(zip(message.memory_names, groups, strict=True)),
    )
