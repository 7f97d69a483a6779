from __future__ import annotations

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64, Float64MultiArray

from flexarm_core.rig_description import described, load_rig
from flexarm_core.signals import Command, Sample
from flexarm_msgs.msg import ArmState, IoCommand, IoSample, MotorCommand
from flexarm_node.codecs import codec_of

FRAME = "flexarm/base_link"
TWO_JOINTS = """
name: two
rate_hz: 500
inputs:
  first: {quantity: torque, unit: N m, limits: 3}
  second: {quantity: torque, unit: N m, limits: 1}
outputs:
  a: {quantity: angle, unit: rad}
  b: {quantity: angle, unit: rad}
  g: {quantity: strain, unit: ustrain}
joints:
  one: {input: first, angle: a, travel: 2}
  two: {input: second, angle: b, travel: 2}
driver: simulated
"""


def test_arm_of_the_thesis___has_messages_in_which_signals_have_names() -> None:
    codec = codec_of(load_rig("thesis"), FRAME)
    assert (codec.sample_topic, codec.command_topic) == ("state", "command")
    sample = Sample(1_500_000_007, 3, (1.0, 2.0, 3.0, 4.0), (5.0,), (0.5,), 2)
    message = deserialize_message(codec.samples.pack(sample), ArmState)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_007)
    assert (message.header.frame_id, message.sequence, message.command_sequence) == (FRAME, 3, 2)
    assert (message.position_v, message.base_strain_v) == (1.0, 2.0)
    assert (message.middle_strain_v, message.speed_v) == (3.0, 4.0)
    assert (message.command_v, message.compensation_v) == (5.0, 0.5)
    assert codec.samples.unpack(serialize_message(message)) == sample
    message.header.frame_id = "another"
    assert codec.samples.unpack(serialize_message(message)) is None
    assert codec.samples.numbers(message) == sample
    command = Command(9, 3, (-1.0,), (0.25,), 2_000_000_001)
    reported = deserialize_message(codec.commands.pack(command), MotorCommand)
    assert (reported.effort_v, reported.compensation_v) == (-1.0, 0.25)
    assert (reported.sequence, reported.state_sequence) == (9, 3)
    assert codec.commands.unpack(serialize_message(reported)) == command


def test_any_other_rig___has_arrays() -> None:
    codec = codec_of(described(TWO_JOINTS), FRAME)
    assert (codec.sample_topic, codec.command_topic) == ("io", "io_command")
    assert codec.reference_topic == "io_reference"
    sample = Sample(5, 8, (0.1, 0.2, 300.0), (1.0, -1.0), (0.0, 0.25), 7)
    message = deserialize_message(codec.samples.pack(sample), IoSample)
    assert (list(message.inputs), list(message.outputs)) == ([1.0, -1.0], [0.1, 0.2, 300.0])
    assert message.header.frame_id == FRAME
    assert (list(message.compensations), message.command_sequence) == ([0.0, 0.25], 7)
    assert codec.samples.unpack(serialize_message(message)) == sample
    command = Command(9, 8, (-1.0, 0.5), (0.25, 0.0), 6)
    reported = deserialize_message(codec.commands.pack(command), IoCommand)
    assert (list(reported.efforts), list(reported.compensations)) == ([-1.0, 0.5], [0.25, 0.0])
    assert (reported.sequence, reported.sample_sequence) == (9, 8)
    assert codec.commands.unpack(serialize_message(reported)) == command
    reported.efforts = [1.0]
    assert codec.commands.unpack(serialize_message(reported)) is None
    assert codec.commands.numbers(reported) is None


@pytest.mark.parametrize(
    ("rig", "message", "set_points"),
    [
        (load_rig("thesis"), Float64(data=1.5), (1.5,)),
        (described(TWO_JOINTS), Float64MultiArray(data=[1.5, -0.5]), (1.5, -0.5)),
    ],
    ids=["thesis", "two joints"],
)
def test_set_points___come_back_from_their_message(
    rig: object, message: object, set_points: tuple[float, ...]
) -> None:
    codec = codec_of(rig, FRAME)  # type: ignore[arg-type]
    references = codec.references(message)
    assert codec.reference_message(references) == message
    assert references == set_points
