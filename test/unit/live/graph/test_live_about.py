"""What a page is told of an arm before anything else."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_core.rig_description import load_rig
from flexarm_live.graph.about import about_arm, columns_of
from support.foreign_rigs import CART, ONE_JOINT, TWO_JOINTS

if TYPE_CHECKING:
    from flexarm_core.rig_description import RigDescription

THESIS_ROWS = {
    "position_v": ("V", "deg", 35.0 / 3.0, "position"),
    "base_strain_v": ("V", "N m", 1.0 / 1.6, "strain"),
    "middle_strain_v": ("V", "N m", 1.0 / 1.1, "strain"),
    "speed_v": ("V", "deg/s", math.degrees(1.0 / 0.2014), "speed"),
    "command_v": ("V", "A", 0.5, "command"),
    "compensation_v": ("V", "A", 0.5, "command"),
    "reference_v": ("V", "deg", 35.0 / 3.0, "position"),
    "sequence_low": ("", "", 1.0, "sequence"),
}


def rows(rig: RigDescription) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in about_arm(rig, simulated=False)["channels"]}


def test_thesis_arm___is_described___as_the_page_has_always_drawn_it() -> None:
    about = about_arm(load_rig("thesis"), simulated=True)
    found = {row.pop("name"): tuple(row.values()) for row in about["channels"]}
    assert list(found) == list(THESIS_ROWS)
    for name, (*words, factor, group) in THESIS_ROWS.items():
        assert found[name] == (*words, pytest.approx(factor), group)
    assert about["arm"]["gauges"] == ["base_strain_v", "middle_strain_v"]
    (joint,) = about["rig"]["joints"]
    assert (joint["angle"], joint["reference"]) == ("position_v", "reference_v")


@pytest.mark.parametrize("rig", [ONE_JOINT, TWO_JOINTS, CART, load_rig("thesis")])
def test_channels___of_any_arm___are_the_columns_of_a_frame(rig: RigDescription) -> None:
    assert tuple(rows(rig)) == columns_of(rig)


@pytest.mark.parametrize(
    ("rig", "name", "unit", "si_unit", "per_unit"),
    [
        (ONE_JOINT, "hub_deg", "deg", "deg", 1.0),
        (ONE_JOINT, "base_v", "V", "N m", 0.25),
        (TWO_JOINTS, "shoulder_count", "count", "deg", 360.0 / 4096.0),
        (TWO_JOINTS, "reference_shoulder_count", "count", "deg", 360.0 / 4096.0),
        (TWO_JOINTS, "elbow_rad_per_s", "rad/s", "deg/s", 180.0 / math.pi),
        (TWO_JOINTS, "tip_g", "g", "m/s^2", 9.80665),
        (TWO_JOINTS, "light", "lux", "lux", 1.0),
        (TWO_JOINTS, "compensation_shoulder_v", "V", "N m", 2.0),
        (CART, "reference_cart_mm", "mm", "m", 1e-3),
    ],
)
def test_channel___of_another_arm___has_the_units_of_its_description(
    rig: RigDescription, name: str, unit: str, si_unit: str, per_unit: float
) -> None:
    row = rows(rig)[name]
    assert (row["unit"], row["si_unit"]) == (unit, si_unit)
    assert row["si_per_unit"] == pytest.approx(per_unit)


def test_channels___of_one_quantity_in_several_units___have_several_plots() -> None:
    groups = {name: row["group"] for name, row in rows(TWO_JOINTS).items()}
    assert groups["shoulder_count"] == groups["reference_shoulder_count"] == "angle, count"
    assert groups["elbow_rad"] == groups["reference_elbow_rad"] == "angle, rad"
    assert groups["elbow_nm"] == groups["compensation_elbow_nm"] == "command, N m"
    assert rows(ONE_JOINT)["hub_deg"]["group"] == "angle"


def test_channel___of_a_joint___ends_with_its_travel() -> None:
    ends = {name: (row.get("low"), row.get("high")) for name, row in rows(TWO_JOINTS).items()}
    assert ends["elbow_rad"] == ends["reference_elbow_rad"] == (-1.5, 2.0)
    assert ends["compensation_elbow_nm"] == (-0.5, 0.8)
    assert ends["tip_g"] == (-8.0, 8.0)
    assert ends["light"] == (-math.inf, math.inf)


def test_another_arm___has___its_joints_and_no_part_of_the_thesis() -> None:
    about = about_arm(TWO_JOINTS, simulated=False)
    assert {"arm", "faults", "tunable_laws"} & set(about) == set()
    assert [each["name"] for each in about["experiments"]][:2] == ["O_dat1", "O_dat2"]
    shoulder, elbow = about["rig"]["joints"]
    assert (shoulder["name"], shoulder["unit"], shoulder["link_length_m"]) == (
        "shoulder",
        "count",
        0.4,
    )
    assert (elbow["reference"], elbow["slides"]) == ("reference_elbow_rad", False)
    assert [each["joint"] for each in about["rig"]["tracked"]] == ["shoulder", "elbow"]
    assert about_arm(CART, simulated=False)["rig"]["joints"][0]["slides"]
