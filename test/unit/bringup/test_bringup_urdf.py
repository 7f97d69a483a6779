from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from flexarm_core.channels import MAX_COMMAND_V, TRAVEL_DEG
from flexarm_daq.nodes.joint_view import BEND_JOINTS, HUB
from flexarm_daq.rigs.rig_parameters import RigParameters
from support.project import PROJECT
from support.rig_physics import bends_at_m
from support.xacro_double import expanded

if TYPE_CHECKING:
    from collections.abc import Iterator

RIG = RigParameters()
FILE = PROJECT / "src/flexarm_bringup/urdf/flexarm.urdf"
ROBOT = ET.parse(FILE).getroot()  # noqa: S314 - our own file
JOINTS = ROBOT.findall("joint")


def attribute(element: ET.Element, path: str, name: str) -> str:
    """Return an attribute of an element below another one."""
    found = element.find(path)
    assert found is not None, path
    return found.attrib[name]


def along_m(joint: ET.Element) -> float:
    """Return where a joint is on the link that carries it."""
    origin = joint.find("origin")
    x, y, z = (
        float(text) for text in (origin.attrib["xyz"] if origin is not None else "0 0 0").split()
    )
    assert (y, z) == (0.0, 0.0)
    return x


def test_joints___are_a_chain_from_the_base_to_the_payload() -> None:
    links = [attribute(joint, "parent", "link") for joint in JOINTS]
    links.append(attribute(JOINTS[-1], "child", "link"))
    assert (links[0], links[-1]) == ("base_link", "payload")
    assert [attribute(joint, "child", "link") for joint in JOINTS] == links[1:]
    assert sorted(link.attrib["name"] for link in ROBOT.findall("link")) == sorted(links)


def test_joints_that_move___are_those_of_joint_states_and_turn_about_the_axis() -> None:
    moving = [joint for joint in JOINTS if joint.attrib["type"] != "fixed"]
    assert [joint.attrib["name"] for joint in moving] == [HUB, *BEND_JOINTS]
    assert {attribute(joint, "axis", "xyz") for joint in moving} == {"0 0 1"}


def test_joints___are_where_the_arm_bends() -> None:
    at_m = np.cumsum([along_m(joint) for joint in JOINTS])
    np.testing.assert_allclose(at_m, [0.0, *bends_at_m(RIG), RIG.length_m])


def test_limits_of_the_hub___are_those_of_travel_and_drive() -> None:
    hub = JOINTS[0]
    limits_rad = [float(attribute(hub, "limit", name)) for name in ("lower", "upper")]
    np.testing.assert_allclose(limits_rad, np.radians([-TRAVEL_DEG, TRAVEL_DEG]), rtol=1e-6)
    effort_nm = float(attribute(hub, "limit", "effort"))
    assert effort_nm == pytest.approx(RIG.motor_gain_nm_per_v * MAX_COMMAND_V)


def test_masses___are_those_of_beam_and_holder() -> None:
    masses_kg = {
        link.attrib["name"]: float(attribute(link, "inertial/mass", "value"))
        for link in ROBOT.findall("link")
        if link.find("inertial") is not None
    }
    assert masses_kg.pop("payload") == pytest.approx(RIG.tip_mass_kg)
    assert sum(masses_kg.values()) == pytest.approx(RIG.mass_per_length_kg_per_m * RIG.length_m)


def test_inertia_about_the_axis___is_that_of_hub_beam_and_holder() -> None:
    about_axis_kg_m2, at_m = 0.0, 0.0
    for joint, following in pairwise([*JOINTS, None]):
        assert joint is not None
        at_m += along_m(joint)
        name = attribute(joint, "child", "link")
        link = next(each for each in ROBOT.findall("link") if each.attrib["name"] == name)
        mass_kg = float(attribute(link, "inertial/mass", "value"))
        origin = link.find("inertial/origin")
        centre_m = at_m + (float(origin.attrib["xyz"].split()[0]) if origin is not None else 0.0)
        own_kg_m2 = float(attribute(link, "inertial/inertia", "izz"))
        about_axis_kg_m2 += own_kg_m2 + mass_kg * centre_m**2
        assert following is None or attribute(following, "parent", "link") == name

    hub_kg_m2 = RIG.motor_inertia_kg_m2 + RIG.load_inertia_kg_m2
    beam_kg_m2 = RIG.mass_per_length_kg_per_m * RIG.length_m**3 / 3.0
    holder_kg_m2 = RIG.tip_mass_kg * RIG.length_m**2
    wanted_kg_m2 = hub_kg_m2 + beam_kg_m2 + holder_kg_m2
    assert about_axis_kg_m2 == pytest.approx(wanted_kg_m2, rel=1e-4)


def words(robot: ET.Element) -> Iterator[tuple[str, dict[str, list[str]]]]:
    """Yield each tag of a robot with the words of its attributes."""
    for each in robot.iter():
        yield each.tag, {name: text.split() for name, text in sorted(each.attrib.items())}


def as_numbers(text: list[str]) -> list[float]:
    """Return words as numbers, those that are none as NaN."""
    return [float(word) if word.lstrip("-")[:1].isdigit() else np.nan for word in text]


def test_plain_file___is_what_the_one_with_macros_makes() -> None:
    made = expanded(FILE.with_suffix(".urdf.xacro"))
    for (tag, attributes), (wanted_tag, wanted) in zip(words(ROBOT), words(made), strict=True):
        assert (tag, [*attributes]) == (wanted_tag, [*wanted])
        for name, text in attributes.items():
            numbers = as_numbers(text)
            np.testing.assert_allclose(numbers, as_numbers(wanted[name]), rtol=1e-9)
            assert text == wanted[name] or not np.isnan(numbers).any()


def test_payload___as_an_argument___adds_to_the_holder() -> None:
    made = expanded(FILE.with_suffix(".urdf.xacro"), payload_kg="0.15")
    (payload,) = made.findall("link[@name='payload']/inertial/mass")
    assert float(payload.attrib["value"]) == pytest.approx(RIG.tip_mass_kg + 0.15)
