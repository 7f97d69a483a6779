"""Columns of messages with lists of texts and messages, beside what rosbags makes of the bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_bags.records.chunks import Messages
from flexarm_bags.records.columns import CdrError, alike, decode, members
from support.foreign_bags import TYPES, header

TREE = "tf2_msgs/msg/TFMessage"
STATE = "sensor_msgs/msg/JointState"

texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)
numbers = st.floats(width=64, allow_nan=False)


def vector(kind: str, values: list[float]) -> Any:  # noqa: ANN401 - made by the typestore
    return TYPES.types[f"geometry_msgs/msg/{kind}"](*values)


def transform(child: str, values: list[float]) -> Any:  # noqa: ANN401
    moved = TYPES.types["geometry_msgs/msg/Transform"](
        translation=vector("Vector3", values[:3]), rotation=vector("Quaternion", values[3:])
    )
    return TYPES.types["geometry_msgs/msg/TransformStamped"](
        header=header(10**18), child_frame_id=child, transform=moved
    )


def serialised(type_name: str, **fields: object) -> bytes:
    return bytes(TYPES.serialize_cdr(TYPES.types[type_name](**fields), type_name))  # type: ignore[arg-type]


def at(message: Any, path: str) -> Any:  # noqa: ANN401
    """Return what a path means in a message that rosbags has deserialised."""
    for part in path.split("."):
        name, *places = part.replace("]", "").split("[")
        message = getattr(message, name)
        for place in places:
            message = message[int(place)]
    return message


def agree(type_name: str, raws: list[bytes]) -> None:
    """Compare every column of every message with its object."""
    layout = members(type_name, TYPES.fielddefs)
    seen: list[int] = []
    for places, columns in alike(Messages.of([0] * len(raws), raws).groups, layout):
        seen += places.tolist()
        for row, place in enumerate(places.tolist()):
            message = TYPES.deserialize_cdr(raws[place], type_name)
            for path, column in columns.items():
                expected, found = at(message, path), column[row]
                if isinstance(expected, str):
                    assert bytes(found).decode() == expected
                else:
                    np.testing.assert_array_equal(found, expected)
    assert sorted(seen) == list(range(len(raws)))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.lists(st.tuples(texts, numbers), max_size=4), min_size=1, max_size=6))
def test_alike___joint_states_of_any_joints___agree_with_rosbags(
    states: list[list[tuple[str, float]]],
) -> None:
    raws = [
        serialised(
            STATE,
            header=header(10**18 + number),
            name=[name for name, _ in joints],
            position=np.array([value for _, value in joints]),
            velocity=np.empty(0),
            effort=np.array([-value for _, value in joints]),
        )
        for number, joints in enumerate(states)
    ]
    agree(STATE, raws)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.lists(st.tuples(texts, st.lists(numbers, min_size=7, max_size=7)), max_size=3),
        min_size=1,
        max_size=5,
    )
)
def test_alike___lists_of_messages___agree_with_rosbags(
    trees: list[list[tuple[str, list[float]]]],
) -> None:
    agree(
        TREE, [serialised(TREE, transforms=[transform(*each) for each in tree]) for tree in trees]
    )


def test_decode___lists___are_left_out() -> None:
    raw = serialised(
        STATE,
        header=header(0),
        name=["a"],
        position=np.array([2.5]),
        velocity=np.empty(0),
        effort=np.empty(0),
    )
    columns = decode(Messages.of([0, 0], [raw, raw]).groups, members(STATE, TYPES.fielddefs))
    assert set(columns) == {
        *("header.stamp.sec", "header.stamp.nanosec"),
        *("position", "velocity", "effort"),
    }
    assert columns["position"].tolist() == [[2.5], [2.5]]


def test_alike___cut_message___is_refused() -> None:
    raw = serialised(TREE, transforms=[transform("b", [0.0] * 7)])
    layout = members(TREE, TYPES.fielddefs)
    for end in (4, 8, 30, len(raw) - 9):
        with pytest.raises(CdrError, match="too short for its definition"):
            list(alike(Messages.of([0], [raw[:end]]).groups, layout))
