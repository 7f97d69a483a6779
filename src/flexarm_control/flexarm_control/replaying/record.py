"""Record of a controlled run: samples, answers, and what the answers follow from beside them."""

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
from flexarm_control.loop_setup import parameters_in
from flexarm_control.models.arm_model import OUTPUTS
from flexarm_core.errors import BagError, SettingError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_bags.reader import Bag
    from flexarm_control.laws.law_protocol import Memory
    from flexarm_core.arrays import FloatArray

    Integers = NDArray[np.int64]


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
