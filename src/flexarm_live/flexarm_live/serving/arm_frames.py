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

    from flexarm_core.rig_description import Joint, RigDescription

TEXT_TYPE = "std_msgs/msg/String"
FRAMES_TYPE = "tf2_msgs/msg/TFMessage"
_STATES_TYPE = "sensor_msgs/msg/JointState"
_Vector = tuple[float, float, float]
_BASE = "base_link"
# Of the drawing alone: a description says how long a link is.
_WIDTH_OF_LENGTH = 0.05
_COLOURS = {"motor": "0.25 0.25 0.25 1", "link": "0.75 0.77 0.8 1"}


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


def urdf_of(rig: RigDescription) -> str:
    """Return the URDF of a rig.

    The arm lies in the plane of x and y, with z up. At rest all links point along x. Each joint
    turns its link about z as the one before it has turned; one whose angle is a length slides it
    along y. The joints have the names that they have in the description and in `joint_states`.

    Parameters
    ----------
    rig : RigDescription
        Rig. Limits of effort are those of the input, in its SI unit. Limits of velocity are the
        travel in one sample: no sensor shows more.
    """
    robot = ET.Element("robot", name=rig.name)
    for name, rgba in _COLOURS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=rgba)
    base = ET.SubElement(robot, "link", name=_BASE)
    if rig.joints:
        radius_m = _WIDTH_OF_LENGTH * rig.joints[0].link_length_m
        shape = {"radius": f"{radius_m:g}", "length": f"{2.0 * radius_m:g}"}
        _add_visual(base, "cylinder", shape, f"0 0 {-radius_m:g}", "motor")
    parent, at_m = _BASE, 0.0
    for number, joint in enumerate(rig.joints, start=1):
        child = f"link{number}"
        moving = _add_joint(robot, joint.name, (parent, child), at_m)
        _limit(moving, rig, joint)
        width_m = _WIDTH_OF_LENGTH * joint.link_length_m
        size = f"{joint.link_length_m:g} {0.2 * width_m:g} {width_m:g}"
        link = ET.SubElement(robot, "link", name=child)
        _add_visual(link, "box", {"size": size}, f"{0.5 * joint.link_length_m:g} 0 0", "link")
        parent, at_m = child, joint.link_length_m
    _add_joint(robot, "fixed_tip", (parent, "tip"), at_m)
    ET.SubElement(robot, "link", name="tip")
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode") + "\n"


def _add_joint(robot: ET.Element, name: str, links: tuple[str, str], at_m: float) -> ET.Element:
    """Add a joint at the end of its parent; it is fixed until it gets limits."""
    parent, child = links
    joint = ET.SubElement(robot, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=f"{at_m:g} 0 0")
    return joint


def _limit(moving: ET.Element, rig: RigDescription, joint: Joint) -> None:
    angle, drive = rig.output(joint.angle), rig.input(joint.input)
    slides = angle.si_unit == "m"
    moving.set("type", "prismatic" if slides else "revolute")
    ET.SubElement(moving, "axis", xyz="0 1 0" if slides else "0 0 1")
    low, high = sorted(map(angle.to_si, (joint.low, joint.high)))
    effort = max(abs(drive.to_si(end)) for end in (drive.low, drive.high))
    limits = {
        "lower": low,
        "upper": high,
        "effort": effort,
        "velocity": (high - low) * rig.rate_hz,
    }
    ET.SubElement(moving, "limit", {name: f"{value:.6g}" for name, value in limits.items()})


def _add_visual(
    link: ET.Element, shape: str, measures: dict[str, str], at: str, material: str
) -> None:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=at)
    ET.SubElement(ET.SubElement(visual, "geometry"), shape, measures)
    ET.SubElement(visual, "material", name=material)
