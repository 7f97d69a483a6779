"""Bag of a run of the loop that no middleware carried: samples, commands, set-points, commander."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import describe, own_types, share_of
from flexarm_bags.writer import BagWriter
from flexarm_core.channels import CHANNEL_NAMES

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_core.signals import Command
    from flexarm_daq.loop.exchange import Record

_NS = 1_000_000_000
_FRAME = "flexarm"
_TYPES = {
    "commander": "flexarm_msgs/msg/CommanderInfo",
    "state": "flexarm_msgs/msg/ArmState",
    "command": "flexarm_msgs/msg/MotorCommand",
    "reference": "std_msgs/msg/Float64",
}
_LATCHED = {"commander", "reference"}


class LoopBag:
    """Writer of the messages that the nodes of the loop would send.

    Parameters
    ----------
    path : Path
        Folder to create.
    namespace : str
        Namespace of the arm.

    Raises
    ------
    RecordingError
        If the bag cannot be created or, later, written.
    """

    def __init__(self, path: Path, namespace: str) -> None:
        self._store = own_types()
        self._names = {key: f"{namespace}/{key}" for key in _TYPES}
        topics = [
            RecordedTopic(
                self._names[key],
                describe(self._store, type_name, share_of),
                TopicQos(durability="transient_local" if key in _LATCHED else "volatile"),
            )
            for key, type_name in _TYPES.items()
        ]
        self._node = f"{namespace}/controller"
        self._bag = BagWriter(path, topics)

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return self._bag.message_count

    def add_commander(self, stamp_ns: int, law: str, *, uses_outputs: bool) -> None:
        """Add who commands from an instant on."""
        self._add(
            "commander",
            stamp_ns,
            header=self._header(stamp_ns),
            node=self._node,
            law=law,
            uses_outputs=uses_outputs,
        )

    def add_state(self, record: Record, stamp_ns: int) -> None:
        """Add one sample."""
        (command_v,), (compensation_v,) = record.commands, record.compensations
        self._add(
            "state",
            stamp_ns,
            header=self._header(stamp_ns),
            sequence=record.sequence,
            **dict(zip(CHANNEL_NAMES, record.outputs.tolist(), strict=True)),
            command_v=command_v,
            compensation_v=compensation_v,
            command_sequence=record.command_sequence,
        )

    def add_reference(self, stamp_ns: int, reference_v: float) -> None:
        """Add a set-point, which is in force until the next one."""
        self._add("reference", stamp_ns, data=reference_v)

    def add_command(self, command: Command) -> None:
        """Add one command."""
        (effort_v,), (compensation_v,) = command.efforts, command.compensations
        self._add(
            "command",
            command.stamp_ns,
            header=self._header(command.stamp_ns),
            sequence=command.sequence,
            state_sequence=command.state_sequence,
            effort_v=effort_v,
            compensation_v=compensation_v,
        )

    def close(self) -> None:
        """Complete the bag."""
        self._bag.close()

    def _header(self, stamp_ns: int) -> object:
        types = self._store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // _NS, nanosec=stamp_ns % _NS)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=_FRAME)

    def _add(self, key: str, time_ns: int, **members: Any) -> None:  # noqa: ANN401
        type_name = _TYPES[key]
        message = self._store.types[type_name](**members)
        raw = bytes(self._store.serialize_cdr(message, type_name))
        self._bag.write(self._names[key], raw, time_ns, time_ns)
