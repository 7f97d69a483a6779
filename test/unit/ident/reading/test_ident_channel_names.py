"""Names of signals in bags of other programs: what a wrong one is told."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from flexarm_core.errors import BagError
from flexarm_ident import read_bag, read_channels, selection
from support.foreign_bags import (
    every_ms,
    float64,
    float64_arrays,
    two_joints,
    wrenches,
    write_topics,
)

if TYPE_CHECKING:
    from pathlib import Path

MCAP = StoragePlugin.MCAP
STATES = "position[shoulder], position[motor], effort[shoulder], effort[motor]"  # velocity is empty


def refused_bag(path: Path) -> Path:
    """Write a bag with which a user can go wrong."""
    felt = wrenches("/ft", every_ms(10, 30, 60_000.0), np.arange(30.0))
    drive = float64_arrays("/drive", every_ms(10, 30), np.zeros((30, 2)))
    around = np.concatenate([every_ms(1, 100), every_ms(1, 100, 3_600_000.0)])
    pause = float64("/pause", around, np.arange(200.0))
    return write_topics(path / "run", [two_joints(30), felt, drive, pause], MCAP)


@pytest.mark.parametrize(
    ("inputs", "outputs", "said"),
    [
        (["/drive.data"], ["/joint_states.position[0]"], "(did you mean data[0..1]?)"),
        (
            ["/drive.data[7]"],
            ["/joint_states.position[0]"],
            "no number data[7] (did you mean data[0..1]?); there are: layout.",
        ),
        (
            ["/drive.data[0]"],
            ["/joint_states.position[2]"],
            "position[2] (did you mean position[shoulder] or position[motor]?); there are: ",
        ),
        (
            ["/drive.data[0]"],
            ["/joint_states"],
            f"name one of its numbers, such as /joint_states.effort[motor]; there are: {STATES}",
        ),
        (["/joint_state"], ["/ft.wrench.force.x"], "no topic /joint_state (did you mean /joint_st"),
        (
            ["/drive.data[0]"],
            ["/joint_states.postion[shoulder]"],
            f"no number postion[shoulder] (did you mean position[shoulder]?); there are: {STATES}",
        ),
        (["/drive.data[0]"], ["/joint_states.velocity[0]"], f"there are: {STATES}"),
        (["/drive.data[0]"], ["/joint_states.name[0]"], f"there are: {STATES}"),
        (
            ["/joint_state.effort[motor]"],
            ["/ft.wrench.force.x"],
            "no topic /joint_state (did you mean /joint_states?); there are: ",
        ),
        (["/nothing.data"], ["/ft.wrench.force.x"], f"(sensor_msgs/msg/JointState): {STATES}"),
        (["/drive.data[0]"], ["/ft.wrench.force.x"], "the topics do not overlap"),
        (["drive"], ["/ft.wrench.force.x"], "'drive' is not a TOPIC.FIELD, such as"),
        (
            ["u=/drive"],
            ["/ft.wrench.force.x"],
            "is a topic: name one of its numbers, such as /drive.data[0]; there are: layout.",
        ),
        (["/drive.data[0]"], [], "no output was named"),
        (
            ["u=/drive.data[0]"],
            ["u=/ft.wrench.force.x"],
            "u is named twice: name channels as NAME=TOPIC.FIELD",
        ),
        (
            ["u=/ft.wrench.force.x"],
            ["y=/ft.wrench.force.x"],
            "/ft.wrench.force.x is an input and an output: take it as one of them",
        ),
    ],
)
def test_read___wrong_names___are_refused_with_what_there_is(
    tmp_path: Path, inputs: list[str], outputs: list[str], said: str
) -> None:
    with pytest.raises(BagError, match=re.escape(said)) as refused:
        read_channels(refused_bag(tmp_path), selection(inputs, outputs))
    assert "\n" not in str(refused.value)


def test_read___foreign_bag_without_channels___lists_its_numbers(tmp_path: Path) -> None:
    said = re.escape(f"{STATES}; /pause (std_msgs/msg/Float64): data; `flexarm identify` takes any")
    with pytest.raises(BagError, match=said):
        read_bag(refused_bag(tmp_path))
