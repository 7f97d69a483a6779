from __future__ import annotations

from typing import Any, TypeAlias

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header

from flexarm_bags.schema import load_typestore
from flexarm_msgs.msg import (
    ArmState,
    ChannelInfo,
    CommanderInfo,
    IoSample,
    MotorCommand,
)
from flexarm_node.topics.layout import Layout
from support.project import PROJECT

Message: TypeAlias = Any
MessageType: TypeAlias = Any

TYPES = [ArmState, MotorCommand]
INTEGERS = {"int32": (-(2**31), 2**31 - 1), "uint32": (0, 2**32 - 1), "uint64": (0, 2**64 - 1)}
FRAME = "flexarm/base_link"
STORE = load_typestore({"flexarm_msgs": PROJECT / "src" / "flexarm_msgs"})


def layout(message_type: type, frame: str = FRAME) -> Layout:
    return Layout(message_type, {"header.frame_id": frame})


def members(message_type: MessageType) -> dict[str, str]:
    return dict(message_type.get_fields_and_field_types())


@st.composite
def messages(draw: st.DrawFn, message_type: MessageType) -> Message:
    """Return a message of our own with any numbers, set by the names in its definition."""
    message = message_type()
    message.header.frame_id = FRAME
    message.header.stamp.sec = draw(st.integers(*INTEGERS["int32"]))
    message.header.stamp.nanosec = draw(st.integers(*INTEGERS["uint32"]))
    for name, kind in members(message_type).items():
        if kind == "double":
            setattr(message, name, draw(st.floats(allow_nan=False)))
        elif kind in INTEGERS:
            setattr(message, name, draw(st.integers(*INTEGERS[kind])))
    return message


def numbers(message: Message) -> list[float]:
    """Return the numbers of a message of our own in the order of its definition."""
    stamp = message.header.stamp
    own = [getattr(message, name) for name in members(message) if name != "header"]
    return [stamp.sec, stamp.nanosec, *own]


@pytest.mark.parametrize("message_type", TYPES)
@settings(max_examples=30)
@given(data=st.data())
def test_random_messages___have_the_bytes_of_rclpy(
    message_type: MessageType, data: st.DataObject
) -> None:
    message = data.draw(messages(message_type))
    packed = layout(message_type).pack(*numbers(message))
    theirs = serialize_message(message)
    assert len(packed) == len(theirs)
    # rclpy leaves in the padding what was there before.
    assert deserialize_message(packed, message_type) == message
    assert list(layout(message_type).unpack(theirs) or ()) == numbers(message)


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("message_type", TYPES)
@settings(max_examples=30)
@given(data=st.data())
def test_random_messages___of_either_endianness___are_read(
    message_type: MessageType, data: st.DataObject, *, little_endian: bool
) -> None:
    message = data.draw(messages(message_type))
    name = f"flexarm_msgs/msg/{message_type.__name__}"
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](
        message.header.stamp.sec, message.header.stamp.nanosec
    )
    header = types["std_msgs/msg/Header"](stamp, FRAME)
    foreign = types[name](header, *numbers(message)[2:])
    raw = bytes(STORE.serialize_cdr(foreign, name, little_endian=little_endian))
    assert list(layout(message_type).unpack(raw) or ()) == numbers(message)
    if little_endian:
        assert layout(message_type).pack(*numbers(message)) == raw


def test_numbers___have_the_names_of_the_definition() -> None:
    message = MotorCommand(sequence=3, state_sequence=4, effort_v=-1.5, compensation_v=0.25)
    message.header.stamp.nanosec = 7
    found = layout(MotorCommand).numbers(message)
    assert found is not None
    assert found._asdict() == {
        "header_stamp_sec": 0,
        "header_stamp_nanosec": 7,
        "sequence": 3,
        "state_sequence": 4,
        "effort_v": -1.5,
        "compensation_v": 0.25,
    }


@pytest.mark.parametrize("frame", ["", "flexarm/base_lin", "arm2/base", "a" * 200])
def test_other_frame___has_another_layout(frame: str) -> None:
    message = MotorCommand(header=Header(frame_id=frame))
    raw = serialize_message(message)
    assert layout(MotorCommand).unpack(raw) is None
    assert layout(MotorCommand, frame).unpack(raw) == layout(MotorCommand).numbers(message)


def test_bytes_of_no_message___are_not_read() -> None:
    own = layout(MotorCommand)
    raw = own.pack(0, 0, 1, 1, 2.0, 0.0)
    wrong = [b"", raw[:4], raw[:-1], raw + bytes(8), b"\0\3" + raw[2:], b"\xff" * len(raw)]
    assert [own.unpack(each) for each in wrong] == [None] * len(wrong)


def test_texts_among_the_numbers___keep_their_places() -> None:
    own = Layout(CommanderInfo, {"header.frame_id": "", "node": "/flexarm/daq", "law": "pd"})
    message = CommanderInfo(node="/flexarm/daq", law="pd", uses_outputs=True)
    message.header.stamp.sec = 5
    assert deserialize_message(own.pack(5, 0, 1), CommanderInfo) == message
    assert tuple(own.unpack(serialize_message(message)) or ()) == (5, 0, 1)
    message.law = "pdpc"
    assert own.unpack(serialize_message(message)) is None


@settings(max_examples=30)
@given(lengths=st.tuples(*[st.integers(1, 5)] * 3), frame=st.text("ab"))
def test_arrays___of_known_lengths___have_the_bytes_of_rclpy(
    lengths: tuple[int, int, int], frame: str
) -> None:
    arrays = dict(zip(("inputs", "outputs", "compensations"), lengths, strict=True))
    own = Layout(IoSample, {"header.frame_id": frame}, arrays)
    message = IoSample(sequence=7, command_sequence=2**40)
    message.header.frame_id = frame
    values: list[float] = []
    for name, length in arrays.items():
        setattr(message, name, [0.5 + len(values) + k for k in range(length)])
        values += getattr(message, name)
    packed = own.pack(0, 0, 7, *values, 2**40)
    assert len(packed) == len(serialize_message(message))
    assert deserialize_message(packed, IoSample) == message
    assert list(own.unpack(serialize_message(message)) or ()) == [0, 0, 7, *values, 2**40]
    assert own.numbers(message) == own.unpack(packed)
    message.outputs = [*message.outputs, 1.0]
    assert own.unpack(serialize_message(message)) is None
    assert own.numbers(message) is None


def test_array_without_a_length___is_refused() -> None:
    with pytest.raises(KeyError, match="inputs"):
        layout(IoSample)


def test_member_without_a_fixed_size___is_refused() -> None:
    with pytest.raises(
        TypeError, match=r"^ChannelInfo\.input_names: sequence<string> has no fixed"
    ):
        layout(ChannelInfo)
