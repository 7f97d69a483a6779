from __future__ import annotations

from typing import TYPE_CHECKING

import ament_index_python.packages
import pytest
import yaml

from support.launch_double import FILE, declared, launched

if TYPE_CHECKING:
    from pathlib import Path

OWN = str(FILE.parents[1] / "config" / "laboratory.yaml")


def files_of(arguments: list[str]) -> list[str]:
    """Return the parameter files of a command line."""
    return [arguments[at + 1] for at, word in enumerate(arguments) if word == "--params-file"]


def test_arguments___are_described() -> None:
    arguments = declared()
    assert set(arguments) == {"namespace", "params_file", "rate_hz", "rig", "law", "bag"}
    assert all(each.description for each in arguments.values())


@pytest.mark.parametrize(
    ("given", "namespace"),
    [
        ({}, "/flexarm"),
        ({"namespace": "arm2"}, "/arm2"),
        ({"ros_namespace": "/lab"}, "/lab"),
        ({"ros_namespace": "/lab", "namespace": "arm2"}, "/lab/arm2"),
    ],
)
def test_namespace___given_or_pushed___is_that_of_every_node(
    given: dict[str, str], namespace: str, tmp_path: Path
) -> None:
    nodes, context = launched(given)

    lines = [node.arguments(context, tmp_path) for node in nodes]

    assert {node.name for node in nodes} == {"recorder", "ident", "controller", "daq"}
    assert all(f"__ns:={namespace}" in line for line in lines)
    enclaves = [line[line.index("--enclave") + 1] for line in lines]
    assert enclaves == [f"{namespace}/{node.name}" for node in nodes]
    assert [files_of(line) for line in lines] == [[OWN]] * 4


def test_arguments___given___come_after_every_file_and_reach_their_node(tmp_path: Path) -> None:
    given = {"rate_hz": "500", "law": "pd", "bag": "2026", "params_file": "mine.yaml"}
    nodes, context = launched(given | {"namespace": "arm2"})

    read: dict[str, object] = {}
    for node in nodes:
        own, mine, *more = files_of(node.arguments(context, tmp_path))
        assert (own, mine) == (OWN, "mine.yaml")
        for file in more:
            read |= yaml.safe_load((tmp_path / file).read_text())

    assert read == {
        "/arm2/daq": {"ros__parameters": {"rate_hz": 500.0}},
        "/arm2/controller": {"ros__parameters": {"law": "pd"}},
        "/arm2/recorder": {"ros__parameters": {"bag": "2026"}},
    }


def test_frames___where_their_node_is_installed___are_those_of_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packages = ament_index_python.packages
    share = FILE.parents[1]
    monkeypatch.setattr(packages, "get_package_prefix", lambda _: "/opt/ros")
    monkeypatch.setattr(packages, "get_package_share_directory", lambda _: str(share))
    nodes, context = launched({"namespace": "arm2"})
    (node,) = [each for each in nodes if each.name == "robot_state_publisher"]

    (file,) = files_of(node.arguments(context, tmp_path))

    parameters = yaml.safe_load((tmp_path / file).read_text())
    values = parameters["/arm2/robot_state_publisher"]["ros__parameters"]
    assert values["robot_description"] == (share / "urdf" / "flexarm.urdf").read_text()
    assert values["frame_prefix"] == "arm2/"
