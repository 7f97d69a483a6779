"""Time of the nodes: `/clock` from an arm in virtual time and from the player, or none at all."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from flexarm_msgs.msg import ArmState, CommanderInfo, MotorCommand
from flexarm_node import qos
from flexarm_node.stamps import stamp_ns
from support.bag_samples import START_NS, played_bag

if TYPE_CHECKING:
    from pathlib import Path

    from std_msgs.msg import Header

    from support.system_graph import Graph

pytestmark = pytest.mark.system

_CLOCK = "/clock"


def heard_times(graph: Graph) -> list[int]:
    """Return a list that gets the times of `/clock`."""
    times: list[int] = []
    graph.node.create_subscription(
        Clock, _CLOCK, lambda message: times.append(stamp_ns(message.clock)), qos.EVERY
    )
    return times


def test_simulated_time_without_a_clock___is_reported_and_stamps_are_the_wall_clocks(
    graph: Graph,
) -> None:
    stamps: dict[str, list[int]] = {"/diagnostics": [], "state": [], "command": [], "commander": []}

    def listen(kind: type, topic: str) -> None:
        graph.node.create_subscription(
            kind,
            topic,
            lambda message: stamps[topic].append(stamp_ns(message.header.stamp)),
            qos.STATUS if topic == "commander" else qos.EVERY,
        )

    listen(DiagnosticArray, "/diagnostics")
    listen(ArmState, "state")
    listen(MotorCommand, "command")
    listen(CommanderInfo, "commander")
    sim = {"use_sim_time": True}
    nodes = [
        graph.start("recorder", sim),
        graph.start("controller", sim),
        graph.start("daq", sim | {"time": "real", "rate_hz": 50.0}),
    ]
    graph.activate_loop()
    graph.operator.activate("daq")
    said = "use_sim_time is set and nobody publishes /clock: stamps are the wall clock's"
    graph.wait(lambda: all(said in node.printed for node in nodes), "the warnings")
    graph.wait(lambda: all(stamps.values()), "every topic")

    now_ns = graph.node.get_clock().now().nanoseconds
    for topic, found in stamps.items():
        assert all(abs(now_ns - each) < 600e9 for each in found), topic
    assert [node.printed.count(said) for node in nodes] == [1, 1, 1]


@pytest.mark.exhaustive
def test_arm_whose_time_runs_ahead___every_stamp_is_of_its_time_and_the_wall_clock_an_entry(
    graph: Graph,
) -> None:
    sampled_ns = [0]
    apart_s: dict[str, float] = {}
    walls_s: dict[str, float] = {}

    def on_state(message: ArmState) -> None:
        sampled_ns[0] = stamp_ns(message.header.stamp)

    def note(name: str, header: Header) -> None:
        apart_s[name] = (stamp_ns(header.stamp) - sampled_ns[0]) * 1e-9

    def on_report(message: DiagnosticArray) -> None:
        (status,) = message.status
        name = status.name.rsplit("/", 1)[-1]
        note(name, message.header)
        walls_s[name] = float(next(e.value for e in status.values if e.key == "wall clock s"))

    listen = graph.node.create_subscription
    listen(ArmState, "state", on_state, qos.NEWEST)
    listen(JointState, "joint_states", lambda each: note("joints", each.header), qos.NEWEST)
    listen(MotorCommand, "command", lambda each: note("command", each.header), qos.NEWEST)
    listen(DiagnosticArray, "/diagnostics", on_report, qos.EVERY)
    for name in ("recorder", "controller"):
        graph.start(name)
    graph.start("daq", {"time": "virtual", "real_time_factor": 0.0, "rate_hz": 10.0})
    graph.activate_loop()
    graph.operator.activate("daq")
    names = ("joints", "command", "daq", "controller", "recorder")

    def ahead_s() -> float:
        return sampled_ns[0] * 1e-9 - time.time()

    graph.wait(lambda: ahead_s() > 100.0, "a lead on the wall clock")
    apart_s.clear()
    walls_s.clear()
    graph.wait(lambda: all(name in apart_s for name in names), "every topic")
    assert all(abs(each) < 60.0 for each in apart_s.values()), apart_s
    assert all(abs(each - time.time()) < 60.0 for each in walls_s.values()), walls_s


@pytest.mark.exhaustive
def test_clock_of_two_arms___is_that_of_one(graph: Graph) -> None:
    parameters = {"autostart": True, "rate_hz": 50.0}
    first = graph.start("daq", parameters, "-r", "__ns:=/arm1")
    second = graph.start("daq", parameters, "-r", "__ns:=/arm2")
    left = (
        "/clock is left to /arm1/daq: nodes with use_sim_time follow the time of that arm; "
        "for this one's own, start its nodes with -r /clock:=NAMESPACE/clock"
    )
    graph.wait(lambda: left in second.printed, "the second one's word")

    def clocks() -> list[str]:
        return [each.node_namespace for each in graph.node.get_publishers_info_by_topic(_CLOCK)]

    # The name of a publisher's node comes after the publisher.
    graph.wait(lambda: clocks() == ["/arm1"], "one clock, of the first arm")
    assert "is left to" not in first.printed
    # Nothing that a user would have to do: nobody is warned.
    assert "WARN" not in first.printed + second.printed


def test_clock_of_another_program___that_stays___is_warned_of(graph: Graph) -> None:
    graph.node.create_publisher(Clock, _CLOCK, qos.SENT)
    daq = graph.start("daq", {"autostart": True, "rate_hz": 50.0}, "-r", "__ns:=/arm1")
    said = "/clock is published by /flexarm/tester too: end that, or set clock=false before"
    graph.wait(lambda: said in daq.printed, "the warning")


def test_player___with_clock___says_the_time_of_the_bag(graph: Graph, tmp_path: Path) -> None:
    messages = played_bag(tmp_path / "played", 100)
    times = heard_times(graph)
    player = graph.run_node("player", {"bag": str(tmp_path / "played"), "clock": True, "rate": 0.5})
    graph.wait(lambda: player.popen.poll() is not None, "the end of the play")
    graph.wait(lambda: len(times) >= len(messages), "every time")
    assert player.exit_code() == 0
    assert times[0] == START_NS
    assert times == sorted(times)
    assert set(times) == {message.time_ns for message in messages}


def test_player___with_clock_beside_another___is_refused(graph: Graph, tmp_path: Path) -> None:
    played_bag(tmp_path / "played", 100)
    graph.node.create_publisher(Clock, _CLOCK, qos.NEWEST)
    player = graph.run_node("player", {"bag": str(tmp_path / "played"), "clock": True})
    assert player.exit_code() == 1
    assert "/clock is published by /flexarm/tester: stop it, then play" in player.printed
