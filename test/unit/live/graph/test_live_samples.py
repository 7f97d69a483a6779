"""Samples from the bytes of the middleware."""

from __future__ import annotations

import math
import struct

import numpy as np

from flexarm_live.graph.samples import (
    COLUMNS,
    REFERENCE,
    SEQUENCE_SPAN,
    STATE,
    STREAMED_REFERENCE,
    SampleReader,
)
from flexarm_msgs.msg import ArmState
from flexarm_node.topics.waiting import RawMessage


def state(
    sequence: int, source_ns: int, *volts: float, frame: str = "flexarm/base_link"
) -> RawMessage:
    """Return an ArmState as CDR, packed by hand: stamp, text, then eight members of 8 bytes."""
    text = frame.encode() + b"\0"
    start = struct.pack("<iII", 100, 500_000_000 + sequence % 1000, len(text)) + text
    padded = start + bytes(-len(start) % 8)
    members = struct.pack("<Q6dQ", sequence, *volts, 7)
    return RawMessage(STATE, b"\x00\x01\x00\x00" + padded + members, source_ns)


def reference(value_v: float, source_ns: int, topic: int = REFERENCE) -> RawMessage:
    return RawMessage(topic, b"\x00\x01\x00\x00" + struct.pack("<d", value_v), source_ns)


def test_reader___of_samples___has_them_in_their_order_with_the_reference_in_force() -> None:
    reader = SampleReader(ArmState)
    messages = [
        state(1, 10, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
        state(2, 30, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, frame="arm2/base_link/x"),
        reference(0.25, 20),
    ]
    found = reader.read(messages)
    assert found is not None
    np.testing.assert_allclose(found.times_s, [100.500000001, 100.500000002], rtol=1e-14)
    expected = [
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, math.nan, 1.0],
        [1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 0.25, 2.0],
    ]
    np.testing.assert_array_equal(found.rows, expected)
    assert found.rows.shape[1] == len(COLUMNS)
    assert (reader.newest, reader.position_v, reader.reference_v) == (2, 1.5, 0.25)


def test_reader___without_a_sample___has_none() -> None:
    reader = SampleReader(ArmState)
    assert reader.read([]) is None
    assert reader.read([reference(1.0, 1)]) is None
    assert reader.reference_v == 1.0


def test_reader___set_points_of_both_readers___are_in_force_in_the_order_of_their_instants() -> (
    None
):
    reader = SampleReader(ArmState)
    both = [reference(1.0, 20), reference(2.0, 30, STREAMED_REFERENCE), reference(1.0, 20)]
    assert reader.read(both) is None
    assert reader.reference_v == 2.0


def test_reader___of_another_byte_order___passes_over_it() -> None:
    message = state(1, 1, *range(6))
    swapped = message._replace(raw=b"\x00\x00" + message.raw[2:])
    assert SampleReader(ArmState).read([swapped]) is None


def test_sequence___of_a_long_run___is_exact_in_float32() -> None:
    sequence = 2**32 + 12345
    found = SampleReader(ArmState).read([state(sequence, 1, *range(6))])
    assert found is not None
    assert int(np.float32(found.rows[0, -1])) == sequence % SEQUENCE_SPAN


def test_samples___after_a_count___are_those_that_came_since() -> None:
    reader = SampleReader(ArmState)
    for first in (1, 4):
        reader.read(
            [state(first + k, 10 * first + k, float(first + k), *range(5)) for k in range(3)]
        )
    assert reader.after(0)["values"]["position_v"].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    found = reader.after(2)
    assert found["taken"] == 6
    assert found["values"]["position_v"].tolist() == [3.0, 4.0, 5.0, 6.0]
    np.testing.assert_allclose(found["t_s"], 100.5 + 1e-9 * np.arange(3, 7), rtol=1e-14)
    assert reader.after(6)["t_s"].size == 0
    # Of a process before this one.
    assert reader.after(1000)["t_s"].size == 6
    assert SampleReader(ArmState).after(0)["taken"] == 0
