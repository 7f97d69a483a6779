from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from flexarm_core.channels import CHANNELS
from flexarm_daq.nodes.joint_view import BEND_JOINTS, HUB
from flexarm_msgs.msg import ArmState, MotorCommand
from flexarm_node import qos
from flexarm_node.stamps import stamp_ns
from support.bag_samples import START_NS, reference, write_bag
from support.exhaustive import first_of
from support.system_graph import PACKAGES, Graph, executable

if TYPE_CHECKING:
    from support.system_graph import Process

pytestmark = pytest.mark.system


@pytest.mark.parametrize("name", PACKAGES)
def test_executable___of_every_node___stands_where_ros2_run_looks(name: str) -> None:
    assert os.access(executable(name), os.X_OK)


@pytest.mark.exhaustive
def test_remapped_node___talks_on_the_other_names(graph: Graph) -> None:
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "/lab/other/state", states.append, qos.SENT)
    graph.node.create_publisher(MotorCommand, "/lab/drive", qos.SENT)
    graph.start(
        "daq",
        {
            "autostart": True,
            "time": "virtual",
            "rate_hz": 100.0,
            "answer_timeout_s": 0.05,
            "listeners": 1,
        },
        *("-r", "__ns:=/lab", "-r", "__node:=rig", "-r", "state:=other/state"),
        *("-r", "command:=drive"),
    )

    graph.wait(lambda: len(states) >= 3, "samples")

    assert [state.sequence for state in states[:3]] == [1, 2, 3]
    stamps_ns = [state.header.stamp.sec * 10**9 + state.header.stamp.nanosec for state in states]
    assert stamps_ns[2] - stamps_ns[1] == stamps_ns[1] - stamps_ns[0] == 10_000_000
    graph.wait(lambda: "/lab/rig" in graph.operator.nodes(), "its name")
    graph.wait(lambda: graph.node.count_subscribers("/lab/drive") == 1, "its other topic")
    assert graph.node.count_publishers("/flexarm/state") == 0


def test_remapped_controller___answers_on_the_other_names(graph: Graph) -> None:
    commands: list[MotorCommand] = []
    graph.node.create_subscription(MotorCommand, "/flexarm/drive", commands.append, qos.NEWEST)
    samples = graph.node.create_publisher(ArmState, "/flexarm/other/state", qos.SENT)
    graph.start(
        "controller",
        {"autostart": True, "law": "pd", "pd.kp": 2.0, "pd.compensation_v": 0.0}
        | {"reference": "constant", "constant.amplitude_v": 0.25},
        *("-r", "state:=other/state", "-r", "command:=drive"),
    )
    graph.wait(lambda: samples.get_subscription_count() == 1, "the controller")
    graph.wait(lambda: graph.node.count_publishers("/flexarm/drive") == 1, "the command's topic")

    def answered() -> bool:
        samples.publish(ArmState(sequence=41))
        return bool(commands)

    graph.wait(answered, "a command")

    assert commands[0].state_sequence == 41
    assert commands[0].effort_v == pytest.approx(2.0 * 0.25)
    assert commands[0].compensation_v == 0.0


@pytest.mark.exhaustive
def test_nodes_with_a_loop___have_no_shared_memory_that_a_late_node_could_stop_them_with(
    graph: Graph,
) -> None:
    # In the range LOCALHOST no node of flexarm has any.
    graph.environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}
    nodes = {name: graph.start(name) for name in ("recorder", "controller", "daq")}
    graph.activate_loop()

    def shares_memory(process: Process) -> bool:
        return "/dev/shm/fast" in Path(f"/proc/{process.popen.pid}/maps").read_text()  # noqa: S108

    # The recorder shows that the question is the right one.
    assert {name: shares_memory(process) for name, process in nodes.items()} == {
        "recorder": True,
        "controller": False,
        "daq": False,
    }


@pytest.mark.parametrize(
    ("settings", "cause"),
    first_of(
        [
            ({"ROS_STATIC_PEERS": "127.0.0.1"}, "as ROS_STATIC_PEERS has it, "),
            ({}, None),
            ({"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}, None),
            (
                {"FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"},
                "as FASTDDS_BUILTIN_TRANSPORTS has it, ",
            ),
        ]
    ),
)
def test_node_with_a_loop___says_when_a_late_node_could_stop_it(
    graph: Graph, settings: dict[str, str], cause: str | None
) -> None:
    graph.environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"} | settings
    process = graph.start("daq")
    graph.wait(lambda: "/flexarm/daq" in graph.operator.nodes(), "the node")
    # A node that is told to stop completes its start first.
    assert graph.stop(process) == 0
    lines = [line for line in process.printed.splitlines() if "uses shared memory" in line]
    assert len(lines) == (cause is not None)
    assert all(f"{cause}this node uses shared memory" in line for line in lines)


def test_controller_on_the_topic___says_its_set_point_and_that_samples_have_stopped(
    graph: Graph,
) -> None:
    references: list[Float64] = []
    reports: list[str] = []
    samples = graph.node.create_publisher(ArmState, "state", qos.SENT)
    graph.node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: reports.extend(
            each.message for each in message.status if each.level == DiagnosticStatus.WARN
        ),
        qos.EVERY,
    )
    # Without a reader of its commands the controller would wait some seconds for one.
    graph.node.create_subscription(MotorCommand, "command", lambda _: None, qos.NEWEST)
    graph.start("controller", {"autostart": True})
    graph.node.create_subscription(Float64, "reference", references.append, qos.STATUS)
    graph.wait(lambda: bool(references), "the set-point in force")
    assert references[0].data == 0.0

    graph.wait(lambda: samples.get_subscription_count() == 1, "the controller")
    samples.publish(ArmState(sequence=1))
    graph.wait(lambda: bool(reports), "a warning")
    assert reports[0] == "active: no samples any more: is the DAQ node active?"


@pytest.mark.parametrize("name", first_of(["daq", "controller"]))
def test_managed_node___goes_through_its_states_twice(graph: Graph, name: str) -> None:
    # The other end of the loop, so that nobody waits for it.
    graph.node.create_subscription(MotorCommand, "command", lambda _: None, qos.NEWEST)
    graph.start(name)
    assert graph.state_of(name) == "unconfigured"
    assert not graph.transition(name, "activate")
    for _ in range(2):
        for label, state in (
            ("configure", "inactive"),
            ("activate", "active"),
            ("deactivate", "inactive"),
            ("cleanup", "unconfigured"),
        ):
            assert graph.transition(name, label)
            assert graph.state_of(name) == state


@pytest.mark.parametrize(
    ("name", "topic", "kind"),
    first_of([("daq", "state", ArmState), ("controller", "command", MotorCommand)]),
)
def test_activation___waits_for_as_many_readers_as_it_is_asked(
    graph: Graph, name: str, topic: str, kind: type
) -> None:
    graph.node.create_subscription(kind, topic, lambda _: None, qos.NEWEST)
    process = graph.start(name, {"listeners": 2})
    assert graph.transition(name, "configure")
    client = graph.node.create_client(ChangeState, f"{name}/change_state")
    graph.wait(client.service_is_ready, "the service")
    graph.operator.acquaint(name)
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE))

    answer = client.call_async(request)

    until_s = time.monotonic() + 1.0
    graph.wait(lambda: time.monotonic() > until_s, "a second")
    assert not answer.done()
    graph.node.create_subscription(kind, topic, lambda _: None, qos.NEWEST)
    graph.wait(answer.done, "the answer")
    assert answer.result().success
    assert "not every reader" not in process.printed


def test_joint_states___have_every_joint_of_the_urdf_bent_as_the_gauges_say(graph: Graph) -> None:
    joints: list[JointState] = []
    states: dict[int, ArmState] = {}
    graph.node.create_subscription(JointState, "joint_states", joints.append, qos.EVERY)
    graph.node.create_subscription(
        ArmState,
        "state",
        lambda state: states.update({stamp_ns(state.header.stamp): state}),
        qos.EVERY,
    )
    graph.start("controller", {"law": "pd", "reference": "step", "step.amplitude_v": 2.0})
    graph.start("daq")
    graph.activate_loop()
    graph.operator.start_sampling()
    graph.wait(lambda: len(joints) > 50, "joint states")
    graph.wait(lambda: stamp_ns(joints[50].header.stamp) in states, "their samples")

    assert {tuple(joint.name) for joint in joints} == {(HUB, *BEND_JOINTS)}
    bent = max(joints[:51], key=lambda joint: abs(sum(joint.position[1:])))
    state = states[stamp_ns(bent.header.stamp)]
    assert bent.position[0] == pytest.approx(CHANNELS[0].to_si(state.position_v))
    # Both gauges show the bend, with the signs of their wiring.
    sign = -np.sign(state.base_strain_v)
    assert sign == np.sign(state.middle_strain_v)
    assert (sign * np.array(bent.position[1:]) > 0.0).all()


def test_recorder___says_what_it_cannot_do(graph: Graph, tmp_path: Path) -> None:
    graph.start("recorder")

    def record(*, on: bool) -> SetBool.Response:
        return graph.call(SetBool, "recorder/record", SetBool.Request(data=on))

    first = record(on=True)
    assert (first.success, first.message) == (
        False,
        "set the parameter bag to the folder to create",
    )

    assert graph.refusal("recorder", {"bag": "~no_such_user/run"}) == ""
    homeless = record(on=True)
    assert not homeless.success
    assert "no home folder of ~no_such_user is known" in homeless.message

    existing = write_bag(tmp_path / "existing", [reference(START_NS, 1.0)])
    assert graph.refusal("recorder", {"bag": str(existing)}) == ""
    second = record(on=True)
    assert not second.success
    assert re.search("existing: exists already and is not overwritten", second.message)

    assert graph.refusal("recorder", {"bag": str(tmp_path / "new")}) == ""
    assert record(on=True).success
    assert record(on=True).message == f"already recording to {tmp_path / 'new'}"
    assert record(on=False).success
    assert record(on=False).message == "was not recording"
