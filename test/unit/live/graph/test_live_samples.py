"""Samples from the bytes of the middleware."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from flexarm_core.rig_description import RigDescription, load_rig
from flexarm_live.graph.about import SEQUENCE_SPAN, columns_of
from flexarm_live.graph.samples import REFERENCE, SAMPLES, STREAMED_REFERENCE, SampleReader
from flexarm_node.topics.waiting import RawMessage
from support.foreign_rigs import CART, ONE_JOINT, TWO_JOINTS

FRAME = "flexarm/base_link"


def thesis_reader() -> SampleReader:
    return SampleReader(load_rig("thesis"), FRAME)


def state(sequence: int, source_ns: int, *volts: float, frame: str = FRAME) -> RawMessage:
    """Return an ArmState as CDR, packed by hand: stamp, text, then eight members of 8 bytes."""
    text = frame.encode() + b"\0"
    start = struct.pack("<iII", 100, 500_000_000 + sequence % 1000, len(text)) + text
    padded = start + bytes(-len(start) % 8)
    members = struct.pack("<Q6dQ", sequence, *volts, 7)
    return RawMessage(SAMPLES, b"\x00\x01\x00\x00" + padded + members, source_ns)


def reference(value_v: float, source_ns: int, topic: int = REFERENCE) -> RawMessage:
    return RawMessage(topic, b"\x00\x01\x00\x00" + struct.pack("<d", value_v), source_ns)


def test_reader___of_samples___has_them_in_their_order_with_the_reference_in_force() -> None:
    reader = thesis_reader()
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
    assert found.rows.shape[1] == len(columns_of(load_rig("thesis")))
    assert (reader.newest, reader.outputs, reader.references) == (2, (1.5, 2.5, 3.5, 4.5), (0.25,))


def test_reader___without_a_sample___has_none() -> None:
    reader = thesis_reader()
    assert reader.read([]) is None
    assert reader.read([reference(1.0, 1)]) is None
    assert reader.references == (1.0,)


def test_reader___set_points_of_both_readers___are_in_force_in_the_order_of_their_instants() -> (
    None
):
    reader = thesis_reader()
    both = [reference(1.0, 20), reference(2.0, 30, STREAMED_REFERENCE), reference(1.0, 20)]
    assert reader.read(both) is None
    assert reader.references == (2.0,)


def test_reader___of_another_byte_order___passes_over_it() -> None:
    message = state(1, 1, *range(6))
    swapped = message._replace(raw=b"\x00\x00" + message.raw[2:])
    assert thesis_reader().read([swapped]) is None


def test_sequence___of_a_long_run___is_exact_in_float32() -> None:
    sequence = 2**32 + 12345
    found = thesis_reader().read([state(sequence, 1, *range(6))])
    assert found is not None
    assert int(np.float32(found.rows[0, -1])) == sequence % SEQUENCE_SPAN


def test_samples___after_a_count___are_those_that_came_since() -> None:
    reader = thesis_reader()
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
    assert thesis_reader().after(0)["taken"] == 0


def io_sample(
    sequence: int, inputs: list[float], outputs: list[float], compensations: list[float]
) -> RawMessage:
    """Return an IoSample as CDR, packed by hand: each array is behind its count."""
    text = FRAME.encode() + b"\0"
    start = struct.pack("<iII", 100, 0, len(text)) + text
    raw = start + bytes(-len(start) % 8) + struct.pack("<Q", sequence)
    for values in (inputs, outputs, compensations):
        raw += struct.pack("<I4x", len(values)) + struct.pack(f"<{len(values)}d", *values)
    return RawMessage(SAMPLES, b"\x00\x01\x00\x00" + raw + struct.pack("<Q", 7), sequence)


def io_references(*values: float) -> RawMessage:
    """Return a Float64MultiArray as CDR, packed by hand, with a dimension that has a label."""
    label = b"set-points\0"
    head = struct.pack("<II", 1, len(label)) + label
    head += bytes(-len(head) % 4) + struct.pack("<III", len(values), len(values), 0)
    head += struct.pack("<I", len(values))
    raw = head + bytes(-len(head) % 8) + struct.pack(f"<{len(values)}d", *values)
    return RawMessage(REFERENCE, b"\x00\x01\x00\x00" + raw, 0)


@pytest.mark.parametrize(
    ("rig", "inputs", "outputs", "compensations", "references"),
    [
        (ONE_JOINT, [0.5], [10.0, 1.0], [0.1], [12.0]),
        (TWO_JOINTS, [0.5, 0.25], [1.0, 2.0, 3.0, 4.0, 5.0], [0.1, 0.2], [100.0, -1.0]),
    ],
)
def test_reader___of_another_arm___has_a_row_of_its_columns(
    rig: RigDescription,
    inputs: list[float],
    outputs: list[float],
    compensations: list[float],
    references: list[float],
) -> None:
    reader = SampleReader(rig, FRAME)
    of_another_rig = io_sample(2, [*inputs, 1.0], outputs, [*compensations, 1.0])
    found = reader.read(
        [io_references(*references), io_sample(1, inputs, outputs, compensations), of_another_rig]
    )
    assert found is not None
    expected = [*outputs, *inputs, *compensations, *references, 1.0]
    np.testing.assert_allclose(found.rows, [expected])
    assert list(reader.after(0)["values"]) == list(columns_of(rig))
    assert reader.outputs == tuple(outputs)


def test_set_points___of_another_number_of_outputs___are_passed_over() -> None:
    reader = SampleReader(TWO_JOINTS, FRAME)
    assert reader.read([io_references(1.0, 2.0, 3.0)]) is None
    assert np.isnan(reader.references).all()


def test_columns___of_another_arm___are_named_after_its_signals() -> None:
    assert columns_of(CART) == (
        "cart_mm",
        "pole_rad",
        "motor_n",
        "compensation_motor_n",
        "reference_cart_mm",
        "sequence_low",
    )
