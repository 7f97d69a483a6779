"""Serialised messages of a made-up experiment for the benchmarks of bags."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.schema import load_typestore
from flexarm_bags.sequence import restamped

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosbags.typesys.store import Typestore

RATE_HZ = 500
STATE, COMMAND = "/flexarm/state", "/flexarm/command"
TYPES = {STATE: "flexarm_msgs/msg/ArmState", COMMAND: "flexarm_msgs/msg/MotorCommand"}
_START_NS = 1_700_000_000_000_000_000
_REPLY_NS = 400_000
_VALUES = 6


@cache
def typestore() -> Typestore:
    """Return the types of the project."""
    messages = Path(__file__).parents[2] / "src" / "flexarm_msgs"
    return load_typestore({"flexarm_msgs": messages})


def experiment(samples: int) -> Iterator[tuple[str, int, bytes]]:
    """Yield topic, time and bytes of state and command at 500 Hz, each sample with other values."""
    step_ns = 10**9 // RATE_HZ
    values = np.random.default_rng(0).integers(-2048, 2048, (samples, _VALUES)) * (10 / 2048)
    state, command = _blank(TYPES[STATE]), _blank(TYPES[COMMAND])
    for k in range(samples):
        time_ns = _START_NS + k * step_ns
        raw = restamped(state, time_ns, k + 1)
        # Six numbers and the command's sequence number end a state.
        yield STATE, time_ns, raw[: -8 * (_VALUES + 1)] + values[k].tobytes() + raw[-8:]
        sent_ns = time_ns + _REPLY_NS
        yield COMMAND, sent_ns, restamped(command, sent_ns, k + 1)


def _blank(type_name: str) -> bytes:
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="flexarm")
    fields = typestore().fielddefs[type_name][1]
    numbers = {name: 0 for name, _ in fields if name != "header"}
    message = types[type_name](header=header, **numbers)
    return bytes(typestore().serialize_cdr(message, type_name))
