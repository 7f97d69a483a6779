from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_bags.sequence import SequenceCheck, restamped, sequence_of
from support.bag_samples import (
    START_NS,
    Sent,
    arm_state,
    io_sample,
    motor_command,
    typestore,
)
from support.serialised import stamp_of

if TYPE_CHECKING:
    from collections.abc import Sequence

NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


@given(sequence=st.integers(0, 2**64 - 1), stamp_ns=st.integers(0, 2**31 * 10**9), name=NAMES)
def test_state___any_header___gives_back_stamp_and_number(
    sequence: int, stamp_ns: int, name: str
) -> None:
    raw = arm_state(sequence, min(stamp_ns, 2**31 * 10**9 - 1), frame_id=name).raw
    assert sequence_of(raw) == sequence
    assert stamp_of(raw) == min(stamp_ns, 2**31 * 10**9 - 1)


@pytest.mark.parametrize(
    "sent", [arm_state(7, START_NS), motor_command(7, START_NS, 1.0), io_sample(7, 1, [1], [2])]
)
def test_restamped___message___is_another_only_in_stamp_and_number(sent: Sent) -> None:
    changed = restamped(sent.raw, 3_000_000_004, 8)
    before = typestore().deserialize_cdr(sent.raw, sent.type_name)
    after = typestore().deserialize_cdr(changed, sent.type_name)
    assert (after.header.stamp.sec, after.header.stamp.nanosec) == (3, 4)  # type: ignore[attr-defined]
    assert after.sequence == 8  # type: ignore[attr-defined]
    after.header.stamp, after.sequence = before.header.stamp, 7  # type: ignore[attr-defined]
    assert bytes(typestore().serialize_cdr(after, sent.type_name)) == sent.raw


@pytest.mark.parametrize("size", [0, 4, 12, 20])
def test_sequence___cut_message___is_an_error(size: int) -> None:
    with pytest.raises(struct.error):
        sequence_of(arm_state(1, START_NS).raw[:size])


def checked(numbers: Sequence[int]) -> SequenceCheck:
    check = SequenceCheck({"/flexarm/state": "flexarm_msgs/msg/ArmState", "/r": "std_msgs/msg/X"})
    for number in numbers:
        check.add("/flexarm/state", arm_state(number, START_NS).raw)
        check.add("/r", b"")
    return check


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ([], (0, 0, 0)),
        ([5], (0, 0, 0)),
        ([1, 2, 3], (0, 0, 0)),
        ([1, 4, 5, 7], (3, 2, 0)),
        ([1, 2, 1, 2], (0, 0, 1)),
        ([3, 3], (0, 0, 1)),
        ([3, 1, 5, 5, 2], (3, 1, 3)),
    ],
)
def test_check___numbers___counts_what_is_missing(
    numbers: list[int], expected: tuple[int, int, int]
) -> None:
    losses = checked(numbers).losses
    assert set(losses) == {"/flexarm/state"}
    found = losses["/flexarm/state"]
    assert (found.missing, found.gaps, found.restarts) == expected


def test_complaints___only_of_missing_messages() -> None:
    assert checked([1, 2, 1]).complaints() == []
    assert checked([1, 4]).complaints() == ["/flexarm/state: 2 periods without a sample at 1 place"]


def test_complaints___of_commands___count_commands() -> None:
    check = SequenceCheck({"/flexarm/command": "flexarm_msgs/msg/MotorCommand"})
    for number in (1, 3, 7):
        check.add("/flexarm/command", motor_command(number, START_NS, 1.0).raw)
    assert check.complaints() == ["/flexarm/command: 4 commands missing at 2 places"]


def test_check___message_that_is_too_short___is_let_pass() -> None:
    check = checked([1])
    check.add("/flexarm/state", b"\0\1")
    check.add("/flexarm/state", arm_state(2, START_NS).raw)
    assert check.complaints() == []
