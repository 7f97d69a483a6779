"""URDF of any arm: its frames are those of a chain in a plane."""

from __future__ import annotations

import cmath
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from flexarm_live.serving.arm_frames import FRAMES_TYPE, ArmFrames, urdf_of
from support.bag_samples import START_NS, header, serialised, typestore
from support.foreign_rigs import CART, ONE_JOINT, TWO_JOINTS


def transforms(urdf: str, positions: dict[str, float]) -> list[Any]:
    state = serialised(
        "sensor_msgs/msg/JointState",
        header=header(START_NS, ""),
        name=list(positions),
        position=np.array(list(positions.values())),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )
    message: Any = typestore().deserialize_cdr(
        ArmFrames(urdf, "arm2/").transforms(state), FRAMES_TYPE
    )
    return list(message.transforms)


def test_frames___of_two_joints___put_the_tip_where_the_links_end() -> None:
    shoulder_rad, elbow_rad = 0.4, -1.1
    place, heading = 0.0 + 0.0j, 1.0 + 0.0j
    for each in transforms(urdf_of(TWO_JOINTS), {"shoulder": shoulder_rad, "elbow": elbow_rad}):
        step, turn = each.transform.translation, each.transform.rotation
        place += heading * complex(step.x, step.y)
        heading *= complex(turn.w, turn.z) ** 2
    expected = cmath.rect(0.4, shoulder_rad) + cmath.rect(0.3, shoulder_rad + elbow_rad)
    assert place == pytest.approx(expected)


def test_frames___of_a_cart___slide_across() -> None:
    cart, tip = transforms(urdf_of(CART), {"cart": 0.2})
    assert (cart.transform.translation.x, cart.transform.translation.y) == (0.0, 0.2)
    assert (cart.transform.rotation.w, cart.transform.rotation.z) == (1.0, 0.0)
    assert (cart.header.frame_id, tip.child_frame_id) == ("arm2/base_link", "arm2/tip")


def test_limits___are___those_of_the_description_in_si_units() -> None:
    robot = ET.fromstring(urdf_of(TWO_JOINTS))  # noqa: S314 - made here
    found = {
        str(joint.get("name")): {name: float(value) for name, value in limit.items()}
        for joint in robot.iter("joint")
        if (limit := joint.find("limit")) is not None
    }
    assert found["shoulder"]["upper"] == pytest.approx(np.pi / 2.0, rel=1e-5)
    assert found["shoulder"]["effort"] == pytest.approx(20.0)
    assert (found["elbow"]["lower"], found["elbow"]["upper"]) == (-1.5, 2.0)
    assert found["elbow"]["effort"] == pytest.approx(0.8)


@pytest.mark.parametrize("rig", [ONE_JOINT, TWO_JOINTS, CART])
def test_urdf___names___a_link_for_each_end_of_a_joint(rig: Any) -> None:  # noqa: ANN401
    robot = ET.fromstring(urdf_of(rig))  # noqa: S314 - made here
    links = {link.get("name") for link in robot.findall("link")}
    ends = {
        end.get("link")
        for joint in robot.findall("joint")
        for end in (joint.find("parent"), joint.find("child"))
        if end is not None
    }
    assert links == ends
    assert len(links) == len(rig.joints) + 2
