"""Codecs of the loop's topics: which messages carry the samples and commands of a rig.

A rig with the signals of the thesis's arm has messages of its own, in which each signal has a name.
Every other rig has arrays, whose names and units stand in its description.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from std_msgs.msg import Float64, Float64MultiArray

from flexarm_core.channels import is_thesis_arm
from flexarm_core.signals import Command, Sample
from flexarm_msgs.msg import ArmState, IoCommand, IoSample, MotorCommand
from flexarm_node.stamps import joined_ns, stamp_members
from flexarm_node.topics.layout import Layout

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_core.rig_description import RigDescription

T = TypeVar("T", Sample, Command)


class Packing(Generic[T]):
    """Packing of samples or commands into the bytes of a message type.

    Parameters
    ----------
    layout : Layout
        Layout of the messages.
    split : callable
        Function from the numbers of a message to the sample or command; `joined` is its inverse.
    joined : callable
        Function from a sample or command to the numbers of its message.

    Attributes
    ----------
    message_type : type
        Class of the messages.
    """

    def __init__(
        self,
        layout: Layout,
        split: Callable[[Sequence[Any]], T],
        joined: Callable[[T], Sequence[float]],
    ) -> None:
        self.message_type = layout.message_type
        self._layout = layout
        self._split: Callable[[Sequence[Any]], T] = split
        self._joined: Callable[[T], Sequence[float]] = joined

    def pack(self, value: T) -> bytes:
        """Return the bytes of a message."""
        return self._layout.pack(*self._joined(value))

    def unpack(self, raw: bytes) -> T | None:
        """Return what a message says; None for one of another layout."""
        found = self._layout.unpack(raw)
        return None if found is None else self._split(found)

    def numbers(self, message: object) -> T | None:
        """Return what a message object says; None for one of other lengths."""
        found = self._layout.numbers(message)
        return None if found is None else self._split(found)


@dataclass(frozen=True)
class Codec:
    """Topics of the loop of one rig.

    Attributes
    ----------
    sample_topic, command_topic, reference_topic : str
        Names of the topics.
    samples : Packing of Sample
        Samples in their messages.
    commands : Packing of Command
        Commands in theirs.
    reference_type : type
        Message of the set-points of the tracked outputs.
    """

    sample_topic: str
    command_topic: str
    reference_topic: str
    samples: Packing[Sample]
    commands: Packing[Command]
    reference_type: type

    def references(self, message: Any) -> tuple[float, ...]:  # noqa: ANN401 - of `reference_type`
        """Return the set-points of a message."""
        return tuple(message.data) if self.reference_type is Float64MultiArray else (message.data,)

    def reference_message(self, references: Sequence[float]) -> Any:  # noqa: ANN401 - likewise
        """Return the message of set-points."""
        if self.reference_type is Float64MultiArray:
            return Float64MultiArray(data=list(references))
        return Float64(data=references[0])


def codec_of(rig: RigDescription, frame: str) -> Codec:
    """Return the codec of a rig, for messages with a frame."""
    inputs, outputs = len(rig.inputs), len(rig.outputs)
    texts = {"header.frame_id": frame}
    if is_thesis_arm(rig):
        return Codec(
            *("state", "command", "reference"),
            Packing(Layout(ArmState, texts), *_sample_order(inputs, outputs, outputs_first=True)),
            Packing(Layout(MotorCommand, texts), *_command_order(inputs)),
            Float64,
        )
    lengths = {"inputs": inputs, "outputs": outputs, "compensations": inputs, "efforts": inputs}
    return Codec(
        *("io", "io_command", "io_reference"),
        Packing(
            Layout(IoSample, texts, lengths), *_sample_order(inputs, outputs, outputs_first=False)
        ),
        Packing(Layout(IoCommand, texts, lengths), *_command_order(inputs)),
        Float64MultiArray,
    )


def _sample_order(
    inputs: int, outputs: int, *, outputs_first: bool
) -> tuple[Callable[[Sequence[Any]], Sample], Callable[[Sample], Sequence[float]]]:
    end = 3 + inputs + outputs
    y, u = slice(3, 3 + outputs), slice(3 + outputs, end)
    if not outputs_first:
        u, y = slice(3, 3 + inputs), slice(3 + inputs, end)

    def split(numbers: Sequence[Any]) -> Sample:
        found = tuple(numbers)
        return Sample(
            joined_ns(found[0], found[1]), found[2], found[y], found[u], found[end:-1], found[-1]
        )

    def joined(sample: Sample) -> Sequence[float]:
        stamp = stamp_members(sample.taken_ns)
        signals = (sample.outputs, sample.commands) if outputs_first else (
            sample.commands, sample.outputs
        )  # fmt: skip
        return (
            *stamp,
            sample.sequence,
            *signals[0],
            *signals[1],
            *sample.compensations,
            sample.command_sequence,
        )

    return split, joined


def _command_order(
    inputs: int,
) -> tuple[Callable[[Sequence[Any]], Command], Callable[[Command], Sequence[float]]]:
    end = 4 + inputs

    def split(numbers: Sequence[Any]) -> Command:
        sec, nanosec, sequence, answered = numbers[:4]
        return Command(
            sequence, answered, tuple(numbers[4:end]), tuple(numbers[end:]), joined_ns(sec, nanosec)
        )

    def joined(command: Command) -> Sequence[float]:
        return (
            *stamp_members(command.stamp_ns),
            command.sequence,
            command.state_sequence,
            *command.efforts,
            *command.compensations,
        )

    return split, joined
