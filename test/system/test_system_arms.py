"""Two arms at once, each in its namespace, from the launch file and by the verbs."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters
from rosgraph_msgs.msg import Clock

from flexarm_bringup.cli import main
from flexarm_ident.reading.read import read_bag_report
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.exhaustive import first_of
from support.launch_double import launched
from support.system_graph import ROOT, Graph, executable

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Process

pytestmark = pytest.mark.system

ARMS = ("arm1", "arm2")
SET_POINT_V = {"arm1": 2.0, "arm2": -1.5}


class Heard:
    """What two arms publish."""

    def __init__(self, graph: Graph) -> None:
        self.states: dict[str, list[ArmState]] = {arm: [] for arm in ARMS}
        self.reports: dict[str, DiagnosticStatus] = {}
        for arm, states in self.states.items():
            graph.node.create_subscription(ArmState, f"/{arm}/state", states.append, qos.EVERY)
        graph.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, qos.EVERY)

    def _on_report(self, message: DiagnosticArray) -> None:
        self.reports.update({each.name: each for each in message.status})

    def is_near_its_set_point(self, arm: str) -> bool:
        states = self.states[arm]
        return bool(states) and abs(states[-1].position_v - SET_POINT_V[arm]) < 0.3

    def drive(self, arm: str) -> str:
        """Return the state of a drive as reported."""
        report = self.reports.get(f"/{arm}/daq", DiagnosticStatus())
        return str({each.key: each.value for each in report.values}.get("drive"))


def start_arm(graph: Graph, arm: str, folder: Path, **arguments: str) -> dict[str, Process]:
    """Start the nodes of the launch file but ident, and return them by their names."""
    nodes, context = launched(arguments | {"namespace": arm})
    folder.mkdir()
    return {
        name: graph.run([str(executable(name)), *node.command_line(context, folder)])
        for node in nodes
        for name in [node.executable.removesuffix("_node")]
        if name != "ident"
    }


def flexarm(graph: Graph, *arguments: str) -> list[str]:
    """Return what a verb prints."""
    process = graph.run([str(ROOT / "flexarm"), *arguments])
    assert process.exit_code() == 0, process.printed
    return process.printed.splitlines()


def test_two_arms___each_in_its_namespace___are_driven_stopped_and_distinguished(
    graph: Graph, tmp_path: Path
) -> None:
    heard = Heard(graph)
    bags = {arm: tmp_path / f"bag_{arm}" for arm in ARMS}
    nodes = {
        arm: start_arm(graph, arm, tmp_path / arm, bag=str(bags[arm]), rate_hz="100", law="pd")
        for arm in ARMS
    }
    graph.wait(lambda: all(heard.states.values()), "samples of both")

    for arm in ARMS:
        flexarm(graph, "reference", str(SET_POINT_V[arm]), "--namespace", arm)
    graph.wait(lambda: all(map(heard.is_near_its_set_point, ARMS)), "both moves")
    stamps_ns = [
        each.header.stamp.sec * 10**9 + each.header.stamp.nanosec
        for each in heard.states["arm2"][:2]
    ]
    assert stamps_ns[1] - stamps_ns[0] == pytest.approx(1e9 / 100.0, abs=2)
    assert heard.states["arm2"][0].header.frame_id == "arm2/base_link"

    held = "the drive is held at zero until the node is deactivated"
    said, release = flexarm(graph, "stop", "--namespace", "arm1")[-2:]
    assert said == held
    assert release.endswith("flexarm activate daq --namespace arm1")
    graph.wait(lambda: heard.drive("arm1") == "held", "the report")
    assert heard.reports["/arm1/daq"].level == DiagnosticStatus.ERROR
    heard.reports.clear()
    names = {f"/{arm}/{node}" for arm in ARMS for node in ("daq", "controller", "recorder")}
    graph.wait(lambda: heard.reports.keys() >= names, "reports of everybody")
    assert heard.drive("arm2") == "driving"
    assert {name: report.hardware_id for name, report in heard.reports.items()} == {
        name: f"{name.rpartition('/')[0]}{' simulated' * name.endswith('daq')}" for name in names
    }
    reported = {each.key: each.value for each in heard.reports["/arm1/daq"].values}
    assert reported["command_v"] == "0 V, 0 A"

    assert sorted(flexarm(graph, "stop", "--all")) == [f"/{arm}: {held}" for arm in ARMS]
    graph.wait(lambda: heard.drive("arm2") == "held", "the second stop")

    for arm in ARMS:
        nodes[arm]["recorder"].send(signal.SIGINT)
        assert nodes[arm]["recorder"].exit_code() == 0
        record = read_bag_report(bags[arm]).data
        position_v = record.y[:, 0]
        assert np.sign(position_v[np.abs(position_v).argmax()]) == np.sign(SET_POINT_V[arm])


@pytest.mark.parametrize("name", ["a-b", "2arms", "a//b"])
def test_namespace_that_is_none___is_refused(name: str) -> None:
    done = CliRunner().invoke(main, ["stop", "--namespace", name])
    assert done.exit_code == 2
    assert f"{name!r} is not a namespace, such as arm2 or lab/arm2" in done.output


@pytest.mark.exhaustive
def test_second_up___with_a_namespace_of_its_own___runs_beside_the_first(graph: Graph) -> None:
    for namespace in ("flexarm", "lab/arm2"):
        words = ["up", "--no-page", "--rate", "50", "--namespace", namespace]
        process = graph.run([str(ROOT / "flexarm"), *words])
        process.wait_for(f"/{namespace} is up: pdpc at 50 Hz")
    again = graph.run([str(ROOT / "flexarm"), "up", "--namespace", "lab/arm2"])
    assert again.exit_code() == 1
    assert "another --namespace" in again.printed


@pytest.mark.parametrize(
    ("section", "said"),
    first_of(
        [
            ("/flexarm/dag", "/flexarm/dag, no node here (nearest: /flexarm/daq)"),
            ("/arm1/daq", "/arm1/daq and none for /flexarm/daq: write /**/daq"),
        ]
    ),
)
def test_file_with_parameters_for_nobody_here___is_refused_by_the_node_that_was_meant(
    graph: Graph, tmp_path: Path, section: str, said: str
) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text(f"{section}:\n  ros__parameters: {{max_command_v: 2.0}}\n")
    process = graph.run_node("daq", {}, "--params-file", str(file))
    assert process.exit_code() == 2
    assert process.printed == f"{file} has parameters for {said}\n"
    graph.start("recorder", {}, "--params-file", str(file))
    graph.operator.await_recorder()


def test_set___misspelt_node___is_refused_with_the_nearest(graph: Graph) -> None:
    graph.start("controller")
    graph.wait(lambda: "/flexarm/controller" in graph.operator.nodes(), "the node")
    process = graph.run([str(ROOT / "flexarm"), "set", "controler", "law=pd"])
    assert process.exit_code() == 1
    assert process.printed == (
        f"flexarm: no node /flexarm/controler was found in ROS domain {graph.domain} within 4 s"
        " (nearest: /flexarm/controller): "
        "start an arm with flexarm up, or use its ROS_DOMAIN_ID and --namespace\n"
    )


@pytest.mark.exhaustive
def test_arm_in_one_process___by_the_launch_file___is_driven_on_a_clock_of_its_own(
    graph: Graph, tmp_path: Path
) -> None:
    heard = Heard(graph)
    times: list[Clock] = []
    graph.node.create_subscription(Clock, "/arm2/clock", times.append, qos.NEWEST)
    arm, other = ARMS
    nodes = start_arm(
        graph, arm, tmp_path / "nodes", compose="true", rate_hz="500", clock="/arm2/clock"
    )
    assert set(nodes) == {"recorder", "loop"}
    graph.wait(lambda: len(heard.states[arm]) > 500 and bool(times), "samples and their clock")
    assert not heard.states[other]
    request = GetParameters.Request(names=["rate_hz"])
    response = graph.operator.call(GetParameters, f"/{arm}/daq/get_parameters", request)
    assert response.values[0].double_value == pytest.approx(500.0)
