"""URDF of an arm, made of its description: a chain of links in a plane, for 3D panels."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

if TYPE_CHECKING:
    from flexarm_core.rig_description import Joint, RigDescription

_BASE = "base_link"
# Of the drawing alone: a description says how long a link is.
_WIDTH_OF_LENGTH = 0.05
_COLOURS = {"motor": "0.25 0.25 0.25 1", "link": "0.75 0.77 0.8 1"}


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
