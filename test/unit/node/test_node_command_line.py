"""Words of a command line that ROS 2 passes over; rclpy's own sorting is the other route."""

from __future__ import annotations

import subprocess
import sys

import pytest
from rclpy.utilities import remove_ros_args

from flexarm_core.errors import SettingError
from flexarm_node.parameter_files import own_words, refuse_words

LINES = [
    "",
    "--ros-args -p a:=1",
    "-p a:=1 --ros-args -p b:=2",
    "--ros-args -p b:=2 -- -p a:=1",
    "one --ros-args -p b:=2 -- two --ros-args -r __ns:=/arm2",
    "a:=1 b",
]


@pytest.mark.parametrize("line", LINES)
def test_own_words___are_those_that_rclpy_leaves(line: str) -> None:
    words = line.split()
    assert own_words(words) == remove_ros_args(["node", *words])[1:]


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ("-p max_command_v:=2.0", "write --ros-args -p max_command_v:=2.0"),
        ("max_command_v:=2.0", "write --ros-args -p max_command_v:=2.0"),
        ("__ns:=/arm2", "write --ros-args -r __ns:=/arm2"),
        ("--params-file rig.yaml", "write --ros-args --params-file rig.yaml"),
        ("pdpc", "leave it out"),
    ],
)
def test_words___that_no_node_reads___are_refused_with_what_to_write(
    line: str, remedy: str
) -> None:
    with pytest.raises(SettingError) as refusal:
        refuse_words(line.split())
    assert str(refusal.value) == f"'{line}' is not after --ros-args, and not read: {remedy}"


NODE = """
from flexarm_node.process import run

class Node:
    def __init__(self):
        raise SystemExit("made")

raise SystemExit(run(Node, takes_words=%s))
"""


@pytest.mark.parametrize("line", ["-p a:=2.0", "-p a:=2.0 --ros-args -p b:=1"])
@pytest.mark.parametrize("takes_words", [False, True])
def test_process___of_a_node_that_takes_no_words___ends_with_the_refusal(
    line: str,
    takes_words: bool,  # noqa: FBT001
) -> None:
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", NODE % takes_words, *line.split()],
        capture_output=True,
        text=True,
        check=False,
    )
    if takes_words:
        assert (done.returncode, done.stderr) == (1, "made\n")
    else:
        assert done.returncode == 2
        assert done.stderr.startswith("'-p a:=2.0' is not after --ros-args")
        assert len(done.stderr.splitlines()) == 1
