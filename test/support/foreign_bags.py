"""Bags as other people's nodes fill them: common messages of a simulated two-mode rig.

The rig is linear and driven by a force that is held, so its outputs are known at any instant: one
filter per mode, exact at the instants of a fine grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.signal import cont2discrete, lfilter

from support.bag_samples import START_NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Integers = NDArray[np.int64]

MS_NS = 1_000_000
JOINTS = ("shoulder", "motor")
FINE_HZ = 10_000
"""Instants at which the rig is simulated."""
DAY_NS = 86_400 * 10**9
MODES_HZ = (4.0, 13.0)
DAMPING = (0.03, 0.02)
# Gains of the modes in position and in acceleration-like strain.
GAINS = ((1.0, 2.5), (0.6, -4.0))
TYPES = get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True)
class Topic:
    """A topic of a bag: its messages in the order of time.

    `received_ns` are the recorder's instants, `raws` the serialised messages.
    """

    name: str
    type_name: str
    received_ns: Integers
    raws: Sequence[bytes]


def held_noise(changes: Integers, fine: int, seed: int) -> Array:
    """Return a white force on the fine grid, which changes at some of its instants."""
    levels = np.random.default_rng(seed).normal(size=len(changes) + 1)
    # Nothing acts before the first message.
    levels[0] = 0.0
    return np.asarray(levels[np.searchsorted(changes, np.arange(fine), side="right")])


def responses(force: Array) -> Array:
    """Return position and strain on the fine grid, (instants, 2), from rest."""
    outputs = np.zeros((len(force), len(GAINS)))
    for hz, zeta, gains in zip(MODES_HZ, DAMPING, zip(*GAINS, strict=True), strict=True):
        omega = 2.0 * np.pi * hz
        numerator, denominator = np.array([omega**2]), np.array([1.0, 2.0 * zeta * omega, omega**2])
        held, poles, _ = cont2discrete((numerator, denominator), 1.0 / FINE_HZ, method="zoh")
        outputs += np.outer(lfilter(held.ravel(), poles, force), gains)
    return outputs


def instants_ns(fine: Integers) -> Integers:
    """Return instants of the fine grid in ns since the epoch."""
    return START_NS + fine * (10**9 // FINE_HZ)


def header(stamp_ns: int) -> Any:  # noqa: ANN401 - made by the typestore
    stamp = TYPES.types["builtin_interfaces/msg/Time"](
        sec=int(stamp_ns) // 10**9, nanosec=int(stamp_ns) % 10**9
    )
    return TYPES.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")


def topic(
    name: str, type_name: str, received_ns: Iterable[int], messages: Iterable[dict[str, Any]]
) -> Topic:
    """Return a topic, each of whose messages is given by its fields."""
    made = (TYPES.types[type_name](**fields) for fields in messages)
    raws = [bytes(TYPES.serialize_cdr(message, type_name)) for message in made]
    return Topic(name, type_name, np.asarray(list(received_ns), dtype=np.int64), raws)


def joint_states(
    stamps_ns: Integers,
    names: Sequence[str],
    positions: Array,
    *,
    efforts: Array | None = None,
    received_ns: Integers | None = None,
) -> Topic:
    """Return JointState on /joint_states, arrays (messages, joints)."""
    unmeasured = np.empty(0)
    return topic(
        "/joint_states",
        "sensor_msgs/msg/JointState",
        stamps_ns if received_ns is None else received_ns,
        (
            {
                "header": header(stamp),
                "name": list(names),
                "position": position,
                "velocity": unmeasured,
                "effort": unmeasured if efforts is None else efforts[number],
            }
            for number, (stamp, position) in enumerate(zip(stamps_ns, positions, strict=True))
        ),
    )


def float64(name: str, times_ns: Integers, values: Array) -> Topic:
    """Return Float64 messages."""
    return topic(name, "std_msgs/msg/Float64", times_ns, ({"data": float(v)} for v in values))


def float64_arrays(name: str, times_ns: Integers, values: Array) -> Topic:
    """Return Float64MultiArray messages, values (messages, elements), with a named dimension."""
    dimension = TYPES.types["std_msgs/msg/MultiArrayDimension"](
        label="motors", size=values.shape[1], stride=values.shape[1]
    )
    layout = TYPES.types["std_msgs/msg/MultiArrayLayout"](dim=[dimension], data_offset=0)
    return topic(
        name,
        "std_msgs/msg/Float64MultiArray",
        times_ns,
        ({"layout": layout, "data": np.array(row)} for row in values),
    )


def wrenches(
    name: str, stamps_ns: Integers, forces: Array, received_ns: Integers | None = None
) -> Topic:
    """Return WrenchStamped messages with a force along x."""
    vector, wrench = (TYPES.types[f"geometry_msgs/msg/{each}"] for each in ("Vector3", "Wrench"))
    nothing = vector(x=0.0, y=0.0, z=0.0)
    return topic(
        name,
        "geometry_msgs/msg/WrenchStamped",
        stamps_ns if received_ns is None else received_ns,
        (
            {
                "header": header(stamp),
                "wrench": wrench(force=vector(x=float(force), y=0.0, z=0.0), torque=nothing),
            }
            for stamp, force in zip(stamps_ns, forces, strict=True)
        ),
    )


def driven_joint(path: Path, seed: int, day: int = 0) -> Path:
    """Write 8 s of the two-mode rig at 200 Hz as JointState of one joint, `arm`."""
    fine = 8 * FINE_HZ
    at = np.arange(0, fine, FINE_HZ // 200)
    force = held_noise(at, fine, seed)
    stamps_ns = instants_ns(at) + day * DAY_NS
    position = responses(force)[at, :1]
    states = joint_states(stamps_ns, ["arm"], position, efforts=force[at, np.newaxis])
    return write_topics(path, [states], StoragePlugin.MCAP)


def write_topics(
    path: Path,
    topics: Sequence[Topic],
    storage: StoragePlugin,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write a bag with the writer of rosbags, its messages in the order of receiving."""
    times_ns = np.concatenate([each.received_ns for each in topics])
    owner = np.repeat(np.arange(len(topics)), [len(each.raws) for each in topics])
    numbers = np.concatenate([np.arange(len(each.raws)) for each in topics])
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {
            name: writer.add_connection(name, type_name, typestore=TYPES)
            for name, type_name in {each.name: each.type_name for each in topics}.items()
        }
        for at in np.argsort(times_ns, kind="stable").tolist():
            raw = topics[owner[at]].raws[numbers[at]]
            writer.write(connections[topics[owner[at]].name], int(times_ns[at]), raw)
    return path


def every_ms(step_ms: float, count: int, first_ms: float = 0.0) -> NDArray[np.int64]:
    """Return so many instants, from the start of the tests' time."""
    after_ns = np.rint((first_ms + step_ms * np.arange(count)) * MS_NS)
    return np.asarray(START_NS + after_ns.astype(np.int64))


def two_joints(count: int, **others: NDArray[np.int64]) -> Topic:
    """Return states at 100 Hz whose values tell joint and number."""
    k = np.arange(count, dtype=np.float64)
    positions, efforts = (np.column_stack([a + k, b + k]) for a, b in ((1000, 2000), (0, 5000)))
    return joint_states(every_ms(10, count), JOINTS, positions, efforts=efforts, **others)
