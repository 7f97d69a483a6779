from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner
from packaging.requirements import Requirement

from flexarm_bringup.cli import main
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

REQUIREMENTS = PROJECT / "requirements" / "ros2cli.in"
# `ros2` prints the middleware's profile and its arguments, and fails.
STAND_IN = r"""#!/bin/sh
echo "$FASTRTPS_DEFAULT_PROFILES_FILE$FASTDDS_DEFAULT_PROFILES_FILE"
printf "%s\n" "$@"
exit 3
"""


def test_ros2___where_it_is_installed___takes_arguments_and_loopback_and_the_exit_code(
    tmp_path: Path,
) -> None:
    program = tmp_path / "ros2"
    program.write_text(STAND_IN)
    program.chmod(0o755)
    path = os.pathsep.join([str(tmp_path), os.environ["PATH"]])
    own = {"FASTRTPS_DEFAULT_PROFILES_FILE": "", "FASTDDS_DEFAULT_PROFILES_FILE": ""}
    where = {"PATH": path, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": ""}
    arguments = ["topic", "pub", "--once", "/a b", "--help", "-1"]

    done = subprocess.run(  # noqa: S603 - our own command
        [sys.executable, "-c", "from flexarm_bringup.cli import main; main()", "ros2", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | own | where,
    )

    assert done.returncode == 3, done.stderr
    profile, *given = done.stdout.splitlines()
    assert profile.endswith("_localhost.xml")
    assert given == arguments


@pytest.mark.parametrize(
    ("root", "distribution", "way_out"),
    [
        ("/checkout", "jazzy", "--no-deps --no-build-isolation -r /checkout/requirements/ros2cli"),
        ("/my arm", "jazzy", "-r '/my arm/requirements/ros2cli.in'"),
        ("/checkout", "kilted", "source a ROS 2 installation that has it"),
        (None, "jazzy", "source a ROS 2 installation that has it"),
    ],
)
def test_ros2___where_it_is_missing___says_in_one_line_how_to_get_it(
    root: str | None,
    distribution: str,
    way_out: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("ROS_DISTRO", distribution)
    monkeypatch.delenv("FLEXARM_ROOT", raising=False)
    if root is not None:
        monkeypatch.setenv("FLEXARM_ROOT", root)

    result = CliRunner().invoke(main, ["ros2", "--help"])

    assert result.exit_code == 1
    (line,) = result.output.splitlines()
    assert line.startswith("flexarm: no ros2 command here: source a ROS 2 installation")
    assert way_out in line


def test_requirements___name_each_package_by_one_tag_of_its_repository() -> None:
    lines = [line.partition(" #")[0] for line in REQUIREMENTS.read_text("utf-8").splitlines()]
    wanted = [Requirement(line) for line in lines if not line.startswith("#")]
    sources = {each.name: each.url for each in wanted if each.url is not None}
    tags = set()
    for name, url in sources.items():
        archive, _, folder = url.partition("#subdirectory=")
        owner, repository, *archives, file = archive.removeprefix("https://github.com/").split("/")
        assert (folder or repository) == name
        assert archives == ["archive", "refs", "tags"]
        tags.add((owner, repository, file.removesuffix(".tar.gz")))
    assert len(tags) == len({repository for _, repository, _ in tags})
    topics = "action interface lifecycle node param pkg run service topic"
    verbs = {f"ros2{topic}" for topic in topics.split()}
    launching = {"launch", "launch_ros", "launch_xml", "launch_yaml", "ros2launch"}
    assert set(sources) == {"ros2cli", "rosidl_runtime_py", "osrf_pycommon"} | verbs | launching


@pytest.mark.skipif("FLEXARM_INSTALL" not in os.environ, reason="needs the built workspace")
def test_packages___are_looked_up_in_the_workspace_before_the_environment() -> None:
    install = os.environ["FLEXARM_INSTALL"]
    folders = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
    are_ours = [folder.startswith(f"{install}/") for folder in folders]
    assert are_ours == sorted(are_ours, reverse=True)
    assert set(are_ours) == {True, False}
