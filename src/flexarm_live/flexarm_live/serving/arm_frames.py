"""Frames of the arm for 3D panels: a joint state becomes the transforms of its description.

A viewer draws a description where `/tf` says, which *robot_state_publisher* makes of the joint
states on a ROS 2 installation. The arm's few joints need no more than this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from rosbags.typesys import Stores, get_typestore

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosbags.typesys.store import Msg

TEXT_TYPE = "std_msgs/msg/String"
FRAMES_TYPE = "tf2_msgs/msg/TFMessage"
_STATES_TYPE = "sensor_msgs/msg/JointState"
_Vector = tuple[float, float, float]


@dataclass(frozen=True)
class _Joint:
    name: str
    slides: bool
    parent: str
    child: str
    origin_m: _Vector
    axis: _Vector


class ArmFrames:
    """Frames of the links of a description.

    Parameters
    ----------
    urdf : str
        URDF. Its joints are fixed, turn about an axis or slide along one, and its frames are not
        turned.
    prefix : str
        Begin of the names of all frames.

    Raises
    ------
    SettingError
        If it is no such description.
    """

    def __init__(self, urdf: str, prefix: str) -> None:
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._prefix = prefix
        self._urdf = urdf
        try:
            robot = ET.fromstring(urdf)  # noqa: S314 - the user's own file
            self._joints = [_joint(each) for each in robot.iter("joint")]
        except (ET.ParseError, ValueError) as error:
            raise SettingError(f"urdf: no description of an arm: {error}") from None

    def description(self) -> bytes:
        """Return the description as a serialised `std_msgs/String`."""
        text = self._types.types[TEXT_TYPE](data=self._urdf)
        return bytes(self._types.serialize_cdr(text, TEXT_TYPE))

    def transforms(self, joint_state: bytes) -> bytes:
        """Return the serialised `tf2_msgs/TFMessage` of a serialised `sensor_msgs/JointState`."""
        state = self._types.deserialize_cdr(joint_state, _STATES_TYPE)
        positions = dict(zip(state.name, state.position, strict=False))  # type: ignore[attr-defined]
        transforms = list(self._transforms(state.header.stamp, positions))  # type: ignore[attr-defined]
        message = self._types.types[FRAMES_TYPE](transforms=transforms)
        return bytes(self._types.serialize_cdr(message, FRAMES_TYPE))

    def _transforms(self, stamp: Msg, positions: dict[str, float]) -> Iterator[Msg]:
        types = self._types.types
        for joint in self._joints:
            position = positions.get(joint.name, 0.0)
            slid_m, half_rad = (position, 0.0) if joint.slides else (0.0, 0.5 * position)
            place_m = [
                origin_m + slid_m * along
                for origin_m, along in zip(joint.origin_m, joint.axis, strict=True)
            ]
            x, y, z = (math.sin(half_rad) * each for each in joint.axis)
            yield types["geometry_msgs/msg/TransformStamped"](
                header=types["std_msgs/msg/Header"](
                    stamp=stamp, frame_id=self._prefix + joint.parent
                ),
                child_frame_id=self._prefix + joint.child,
                transform=types["geometry_msgs/msg/Transform"](
                    translation=types["geometry_msgs/msg/Vector3"](
                        **dict(zip("xyz", place_m, strict=True))
                    ),
                    rotation=types["geometry_msgs/msg/Quaternion"](
                        x=x, y=y, z=z, w=math.cos(half_rad)
                    ),
                ),
            )


def _joint(element: ET.Element) -> _Joint:
    """Return a joint; a ValueError for a kind that the arm does not have."""
    name = element.get("name", "")
    kind = element.get("type")
    is_turned = _vector(element, "origin", "rpy") != (0.0, 0.0, 0.0)
    if kind not in {"fixed", "revolute", "prismatic"} or is_turned:
        raise ValueError(
            f"joint {name} is neither fixed nor revolute nor prismatic, or its frame is turned"
        )
    return _Joint(
        name,
        kind == "prismatic",
        _link(element, "parent"),
        _link(element, "child"),
        _vector(element, "origin", "xyz"),
        _vector(element, "axis", "xyz"),
    )


def _link(joint: ET.Element, place: str) -> str:
    found = joint.find(place)
    if found is None or "link" not in found.attrib:
        raise ValueError(f"joint {joint.get('name')} has no {place}")
    return found.attrib["link"]


def _vector(joint: ET.Element, place: str, name: str) -> _Vector:
    """Return three numbers; zeros when they are not there, as URDF has it."""
    found = joint.find(place)
    words = ("" if found is None else found.get(name, "")).split() or ["0"] * 3
    x, y, z = map(float, words)
    return x, y, z
