from __future__ import annotations

from pathlib import Path

import ament_index_python.packages
import pytest
import yaml

from support.launch_double import FILE, declared, launched, reported

SHARE = FILE.parents[1]
SETTINGS = {"rate_hz", "rig", "law", "bag"}
OWN = str(SHARE / "config" / "laboratory.yaml")


def files_of(arguments: list[str]) -> list[str]:
    """Return the parameter files of a command line."""
    return [arguments[at + 1] for at, word in enumerate(arguments) if word == "--params-file"]


def test_arguments___are_described() -> None:
    arguments = declared()
    others = {"page", "foxglove", "view", "compose", "real_time", "clock"}
    assert set(arguments) == {"namespace", "params_file", *others, *SETTINGS}
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
    nodes, context = launched(given | {"compose": "false"})

    lines = [node.command_line(context, tmp_path) for node in nodes]

    assert {node.name for node in nodes} == {"recorder", "ident", "controller", "daq"}
    assert all(f"__ns:={namespace}" in line for line in lines)
    enclaves = [line[line.index("--enclave") + 1] for line in lines]
    assert enclaves == [f"{namespace}/{node.name}" for node in nodes]
    assert [files_of(line) for line in lines] == [[OWN]] * 4


@pytest.mark.parametrize(
    ("argument", "names"), [("page", {"live", "experiment"}), ("foxglove", {"foxglove"})]
)
@pytest.mark.parametrize("value", ["true", "false"])
def test_nodes_on_request___start___when_they_are_wanted(
    argument: str, names: set[str], value: str
) -> None:
    nodes, _ = launched({argument: value})
    started = {node.name for node in nodes} - {node.name for node in launched({})[0]}
    assert started == (names if value == "true" else set())


def test_viewers___get_the_description_of_the_arm(tmp_path: Path) -> None:
    nodes, context = launched({"foxglove": "true"})
    (node,) = [each for each in nodes if each.name == "foxglove"]
    *_, file = files_of(node.command_line(context, tmp_path))
    values = yaml.safe_load((tmp_path / file).read_text())["/flexarm/foxglove"]["ros__parameters"]
    assert values == {"urdf": str(SHARE / "urdf" / "flexarm.urdf")}


def test_arguments___given___come_after_every_file_and_reach_their_node(tmp_path: Path) -> None:
    given = {"rate_hz": "500", "law": "pd", "bag": "2026", "params_file": "mine.yaml"}
    given["compose"] = "false"
    nodes, context = launched(given | {"namespace": "arm2"})

    read: dict[str, object] = {}
    for node in nodes:
        own, mine, *more = files_of(node.command_line(context, tmp_path))
        assert (own, mine) == (OWN, "mine.yaml")
        for file in more:
            read |= yaml.safe_load((tmp_path / file).read_text())

    assert read == {
        "/arm2/daq": {"ros__parameters": {"rate_hz": 500.0}},
        "/arm2/controller": {"ros__parameters": {"law": "pd"}},
        "/arm2/recorder": {"ros__parameters": {"bag": "2026"}},
    }


def test_real_time___is_a_parameter_of_the_daq_node(tmp_path: Path) -> None:
    nodes, context = launched({"real_time": "true", "compose": "false"})
    (daq,) = [each for each in nodes if each.name == "daq"]
    *_, file = files_of(daq.command_line(context, tmp_path))
    values = yaml.safe_load((tmp_path / file).read_text())["/flexarm/daq"]["ros__parameters"]
    assert values == {"time": "real"}


def test_compose___starts_both_nodes_of_the_loop_in_one_process(tmp_path: Path) -> None:
    given = {"compose": "true", "rate_hz": "1000", "law": "pd", "real_time": "true"}
    nodes, context = launched(given | {"namespace": "arm2", "params_file": "mine.yaml"})
    (loop,) = [each for each in nodes if each.name is None]
    line = loop.command_line(context, tmp_path)
    before, after = line[: line.index("--ros-args")], line[line.index("--ros-args") :]
    assert (loop.package, loop.executable) == ("flexarm_bringup", "loop_node")
    assert before == ["daq.rate_hz:=1000.0", "daq.time:=real", "controller.law:=pd"]
    assert not any("__node" in word for word in after)
    assert "/arm2/loop" in after
    assert files_of(line) == [OWN, "mine.yaml"]
    assert {node.name for node in nodes} == {"recorder", "ident", None}


@pytest.mark.parametrize(
    ("rig", "in_file", "is_one"),
    [
        ("", None, True),
        ("simulated", None, True),
        ("mujoco-thesis", None, True),
        ("nidaq", None, False),
        ("", "nidaq", False),
        ("simulated", "nidaq", True),
        ("nowhere.yaml", None, False),
    ],
)
def test_loop___of_a_simulated_arm___is_one_process_that_of_a_board_two(
    *, rig: str, in_file: str | None, is_one: bool, tmp_path: Path
) -> None:
    file = tmp_path / "mine.yaml"
    section = {"rate_hz": 300.0} | ({"rig": in_file} if in_file else {})
    file.write_text(yaml.safe_dump({"/**/daq": {"ros__parameters": section}}))
    nodes, _ = launched({"rig": rig, "params_file": str(file)})
    loop = {None} if is_one else {"controller", "daq"}
    assert {node.name for node in nodes} == {"recorder", "ident"} | loop


def test_clock___that_is_named___takes_the_place_of_the_usual_one(tmp_path: Path) -> None:
    nodes, context = launched({"namespace": "arm2", "clock": "/arm2/clock"})
    lines = [node.command_line(context, tmp_path) for node in nodes]
    assert all("/clock:=/arm2/clock" in line for line in lines)
    assert not any(":=/clock" in word for line in lines for word in line)


@pytest.fixture
def installation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every package be installed."""
    packages = ament_index_python.packages
    monkeypatch.setattr(packages, "get_package_prefix", lambda _: "/opt/ros")
    monkeypatch.setattr(packages, "get_package_share_directory", lambda _: str(SHARE))


@pytest.mark.usefixtures("installation")
def test_frames___where_their_node_is_installed___are_those_of_the_arm(tmp_path: Path) -> None:
    nodes, context = launched({"namespace": "arm2"})
    (node,) = [each for each in nodes if each.name == "robot_state_publisher"]

    (file,) = files_of(node.command_line(context, tmp_path))

    parameters = yaml.safe_load((tmp_path / file).read_text())
    values = parameters["/arm2/robot_state_publisher"]["ros__parameters"]
    assert values["robot_description"] == (SHARE / "urdf" / "flexarm.urdf").read_text()
    assert values["frame_prefix"] == "arm2/"


@pytest.mark.usefixtures("installation")
@pytest.mark.parametrize("namespace", ["flexarm", "lab/arm2"])
def test_view___where_it_is_installed___shows_the_description_and_the_frames_of_the_arm(
    namespace: str,
) -> None:
    nodes, _ = launched({"namespace": namespace, "view": "True"})
    (node,) = [each for each in nodes if each.package == "rviz2"]
    option, file = node.arguments
    settings = yaml.safe_load(Path(file).read_text("utf-8"))
    Path(file).unlink()
    assert option == "-d"
    manager = settings["Visualization Manager"]
    (arm,) = [each for each in manager["Displays"] if each["Class"].endswith("/RobotModel")]
    assert arm["Description Topic"]["Value"] == f"/{namespace}/robot_description"
    assert arm["TF Prefix"] == namespace
    assert manager["Global Options"]["Fixed Frame"] == f"{namespace}/base_link"


def test_view___where_it_is_not_installed___says_so_and_starts_the_nodes() -> None:
    (line,) = reported({"view": "true"})
    assert line == "view:=true needs robot_state_publisher and rviz2: not installed here"
    assert len(launched({"view": "true"})[0]) == len(launched({})[0])
    assert reported({}) == []
