"""Bags for tests: messages by their fields, written by our writer or by rosbags' own."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import yaml
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from flexarm_bags.metadata import RecordedTopic
from flexarm_bags.schema import describe, load_typestore
from flexarm_bags.writer import BagWriter
from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from rosbags.typesys.store import Msg, Typestore

MESSAGE_PACKAGES = {"flexarm_msgs": PROJECT / "src" / "flexarm_msgs"}
START_NS = 1_700_000_000_000_000_000
STEP_NS = 2_000_000
PLAYED_STEP_NS = STEP_NS
"""Period of `played_bag`."""
FOREIGN_FORMATS = [
    (StoragePlugin.MCAP, CompressionMode.NONE),
    (StoragePlugin.MCAP, CompressionMode.STORAGE),
    (StoragePlugin.MCAP, CompressionMode.FILE),
    (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    (StoragePlugin.SQLITE3, CompressionMode.NONE),
    (StoragePlugin.SQLITE3, CompressionMode.FILE),
    (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
]
"""Storages and compressions that rosbags writes."""


class Sent(NamedTuple):
    """One message as it leaves a publisher."""

    topic: str
    type_name: str
    time_ns: int
    raw: bytes


@cache
def typestore() -> Typestore:
    """Return the types of the project."""
    return load_typestore(MESSAGE_PACKAGES)


def header(stamp_ns: int, frame_id: str = "") -> Msg:
    """Return a std_msgs/Header."""
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def serialised(type_name: str, **fields: object) -> bytes:
    """Return the CDR bytes of a message."""
    message = typestore().types[type_name](**fields)  # type: ignore[arg-type]
    return bytes(typestore().serialize_cdr(message, type_name))


def arm_state(
    sequence: int,
    stamp_ns: int,
    outputs: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    *,
    command_v: float = 0.0,
    compensation_v: float = 0.0,
    command_sequence: int = 0,
    frame_id: str = "",
) -> Sent:
    """Return an ArmState on /flexarm/state."""
    type_name = "flexarm_msgs/msg/ArmState"
    position, base, middle, speed = outputs
    raw = serialised(
        type_name,
        header=header(stamp_ns, frame_id),
        sequence=sequence,
        position_v=position,
        base_strain_v=base,
        middle_strain_v=middle,
        speed_v=speed,
        command_v=command_v,
        compensation_v=compensation_v,
        command_sequence=command_sequence,
    )
    return Sent("/flexarm/state", type_name, stamp_ns, raw)


def motor_command(
    sequence: int,
    time_ns: int,
    effort_v: float,
    *,
    state_sequence: int | None = None,
    compensation_v: float = 0.0,
) -> Sent:
    """Return a MotorCommand on /flexarm/command; it answers the sample of its own number."""
    type_name = "flexarm_msgs/msg/MotorCommand"
    raw = serialised(
        type_name,
        header=header(time_ns),
        sequence=sequence,
        state_sequence=sequence if state_sequence is None else state_sequence,
        effort_v=effort_v,
        compensation_v=compensation_v,
    )
    return Sent("/flexarm/command", type_name, time_ns, raw)


def commander_info(time_ns: int, *, uses_outputs: bool, node: str = "/n") -> Sent:
    """Return a CommanderInfo on /flexarm/commander."""
    type_name = "flexarm_msgs/msg/CommanderInfo"
    raw = serialised(
        type_name, header=header(time_ns), node=node, law="law", uses_outputs=uses_outputs
    )
    return Sent("/flexarm/commander", type_name, time_ns, raw)


def reference(time_ns: int, value_v: float) -> Sent:
    """Return a Float64 on /flexarm/reference."""
    type_name = "std_msgs/msg/Float64"
    return Sent("/flexarm/reference", type_name, time_ns, serialised(type_name, data=value_v))


def io_sample(
    sequence: int,
    stamp_ns: int,
    inputs: Sequence[float],
    outputs: Sequence[float],
    compensations: Sequence[float] = (),
) -> Sent:
    """Return an IoSample on /flexarm/io; that of a running rig has compensations."""
    type_name = "flexarm_msgs/msg/IoSample"
    raw = serialised(
        type_name,
        header=header(stamp_ns),
        sequence=sequence,
        inputs=np.array(inputs, dtype=np.float64),
        outputs=np.array(outputs, dtype=np.float64),
        compensations=np.array(compensations, dtype=np.float64),
        command_sequence=0,
    )
    return Sent("/flexarm/io", type_name, stamp_ns, raw)


def io_reference(time_ns: int, *values: float) -> Sent:
    """Return the set-points of a rig on /flexarm/io_reference."""
    type_name = "std_msgs/msg/Float64MultiArray"
    types = typestore().types
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    raw = serialised(type_name, layout=layout, data=np.array(values))
    return Sent("/flexarm/io_reference", type_name, time_ns, raw)


def rig_description(time_ns: int, text: str) -> Sent:
    """Return a rig's description on /flexarm/rig_description."""
    type_name = "std_msgs/msg/String"
    return Sent("/flexarm/rig_description", type_name, time_ns, serialised(type_name, data=text))


def channel_info(
    time_ns: int, inputs: Sequence[str], outputs: Sequence[str], rate_hz: float
) -> Sent:
    """Return a ChannelInfo of a closed loop on /flexarm/io_channels."""
    type_name = "flexarm_msgs/msg/ChannelInfo"
    raw = serialised(
        type_name,
        header=header(time_ns),
        sampling_rate_hz=rate_hz,
        input_names=list(inputs),
        input_units=["V"] * len(inputs),
        output_names=list(outputs),
        output_units=[""] * len(outputs),
        source="another rig",
        closed_loop=True,
    )
    return Sent("/flexarm/io_channels", type_name, time_ns, raw)


def experiment(samples: int) -> list[Sent]:
    """Return a reference, and states and commands at 500 Hz."""
    messages = [reference(START_NS, 0.5)]
    for k in range(samples):
        stamp_ns = START_NS + k * STEP_NS
        messages += [
            arm_state(k + 1, stamp_ns, (0.1 * k, 1.0, 2.0, -0.1 * k), command_v=0.01 * k),
            motor_command(k + 1, stamp_ns + 400_000, 0.01 * (k + 1)),
        ]
    return messages


def topics_of(messages: Iterable[Sent]) -> dict[str, str]:
    """Return topic -> type in the order of appearance."""
    return {message.topic: message.type_name for message in messages}


def mcap_file(bag: Path) -> Path:
    """Return the only file of a bag."""
    (file,) = bag.glob("*.mcap")
    return file


def information(bag: Path) -> dict[str, object]:
    """Return what the metadata of a bag says."""
    content = yaml.safe_load((bag / "metadata.yaml").read_text())
    found: dict[str, object] = content["rosbag2_bagfile_information"]
    return found


def recorded_topics(messages: Iterable[Sent]) -> list[RecordedTopic]:
    """Return what a recorder of these messages would be told."""
    return [
        RecordedTopic(topic, describe(typestore(), type_name))
        for topic, type_name in topics_of(messages).items()
    ]


def write_in_chunks(path: Path, messages: Sequence[Sent], per_chunk: int) -> Path:
    """Write messages with our own writer, so many in each chunk."""
    with BagWriter(path, recorded_topics(messages), flush_period_s=1e6) as bag:
        for number, message in enumerate(messages, start=1):
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            if number % per_chunk == 0:
                bag.flush()
    return path


def write_bag(path: Path, messages: Sequence[Sent]) -> Path:
    """Write messages with our own writer."""
    with BagWriter(path, recorded_topics(messages)) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
    return path


def write_foreign_bag(
    path: Path,
    messages: Sequence[Sent],
    storage: StoragePlugin,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write messages with the writer of rosbags."""
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, type_name, typestore=typestore())
            for topic, type_name in topics_of(messages).items()
        }
        for message in messages:
            writer.write(connections[message.topic], message.time_ns, message.raw)
    return path


def played_bag(path: Path, samples: int) -> list[Sent]:
    """Write a bag at 500 Hz and return its messages."""
    messages = [reference(START_NS, 3.0)]
    for k in range(samples):
        time_ns = START_NS + k * PLAYED_STEP_NS
        messages += [
            arm_state(k + 1, time_ns, (0.01 * k, 1.0, 2.0, 3.0), command_v=0.02 * k),
            motor_command(k + 1, time_ns + 500_000, 0.02 * (k + 1)),
        ]
    write_bag(path, messages)
    return messages


def controlled_run(samples: int = 200) -> list[Sent]:
    """Return what a controlled rig sends: samples, answers, and set-points now and then."""
    messages: list[Sent] = []
    for k in range(samples):
        time_ns = START_NS + k * STEP_NS
        if k % 50 == 0:
            messages.append(reference(time_ns - 1, float(k)))
        messages += [
            arm_state(k + 1, time_ns, (0.1 * k, 1.0, 2.0, -0.1 * k), command_v=0.01 * k),
            motor_command(k + 1, time_ns + 400_000, 0.01 * (k + 1)),
        ]
    return messages


def outputs(k: int) -> tuple[float, float, float, float]:
    """Return outputs that tell their number."""
    return (float(k), 10.0 + k, 20.0 + k, -float(k))


def open_loop(sequences: Sequence[int]) -> list[Sent]:
    """Return states whose values tell their sequence number: command_v is 100 + sequence."""
    return [
        arm_state(
            sequence,
            START_NS + sequence * STEP_NS,
            outputs(sequence),
            command_v=100.0 + sequence,
            compensation_v=0.5 * sequence,
        )
        for sequence in sequences
    ]
