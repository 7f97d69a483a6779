from __future__ import annotations

import re
import signal
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock  # type: ignore[import-untyped,unused-ignore]

from flexarm_msgs.msg import MotorCommand
from flexarm_node import qos
from flexarm_node.stamps import stamp_ns
from support.fault_campaign import MAX_AGE_PERIODS, Campaign, random_moments_s
from support.recorded_samples import States
from support.system_graph import Graph, eventually

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.system_graph import Process

pytestmark = pytest.mark.system

DAQ = {"rate_hz": 300.0}
FAILING_NODE = """
from flexarm_node.loop_node import LoopNode
from flexarm_core.specs import ParameterSpec
from flexarm_node.process import run

class Failing(LoopNode):
    def __init__(self):
        super().__init__("failing", (ParameterSpec("where", "nowhere", "what fails"),))

    def fail(self, where):
        if self.parameters.values()["where"] == where:
            raise KeyError(where)

    def make_topics(self):
        self.fail("configure")

    def release_topics(self): ...

    def prepare(self):
        self.fail("activate")

    def loop(self, stopping):
        self.fail("loop")
        while not stopping.wait(0.1):
            self.spare_time()

    def figures(self):
        yield {}

run(Failing)
"""

WORKING_NODE = """
import threading
import numpy as np
import scipy.fft
from rclpy.node import Node
from flexarm_node.process import run

class Working(Node):
    def __init__(self):
        super().__init__("working", namespace="/flexarm")
        threading.Thread(target=self.work, daemon=True).start()

    def work(self):
        print("at work", flush=True)
        while True:
            scipy.fft.rfft(np.zeros(1 << 18))

    def stop(self): ...

raise SystemExit(run(Working))
"""

ASKING_NODE = """
from rclpy.duration import Duration
from rclpy.node import Node
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from flexarm_node.topics.waiting import wait_until
from flexarm_node.process import request_stop, run

class Asking(Node):
    def __init__(self):
        super().__init__("asking", namespace="/flexarm")
        self.states = self.create_publisher(ArmState, "state", qos.SENT)
        self.create_timer(0.1, self.ask)

    def ask(self):
        known = wait_until(lambda: self.states.get_subscription_count() == 1)
        self.states.publish(ArmState())
        acknowledged = self.states.wait_for_all_acked(Duration(seconds=1.0))
        print(f"reader known: {known}, acknowledged: {acknowledged}", flush=True)
        request_stop()

    def stop(self): ...

raise SystemExit(run(Asking, realtime=True))
"""


def run_script(graph: Graph, file: Path, source: str) -> Process:
    """Write a node and start it."""
    file.write_text(source, "utf-8")
    return graph.run([sys.executable, str(file)])


@pytest.fixture
def campaign(graph: Graph, tmp_path: Path) -> Campaign:
    made = Campaign(graph, tmp_path)
    made.start(DAQ)
    return made


@pytest.fixture(scope="module")
def broken_rigs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Campaign]:
    """Return one graph for all faults of the rig."""
    folder = tmp_path_factory.mktemp("broken")
    with Graph(folder) as graph:
        made = Campaign(graph, folder)
        made.start(DAQ)
        made.start_controller()
        made.warm_up()
        yield made


@pytest.mark.parametrize(
    ("fault", "periods", "state", "reason"),
    [
        ("stuck", 30, "active", "held at zero: position_v (is stuck|and speed_v disagree)"),
        ("not_a_number", 1, "active", "held at zero: position_v is not a number"),
        ("short_read", 0, "inactive", "short reading: 3 of 4 channels"),
        ("frozen_time", 0, "inactive", "clock stands still"),
        ("write_error", MAX_AGE_PERIODS, "inactive", "the command could not be written"),
        ("exception", 0, "inactive", r"ArithmeticError: injected.* \(faulty\.py:\d+\)"),
    ],
)
def test_broken_rig___takes_the_drive_to_zero_and_says_why(
    broken_rigs: Campaign, fault: str, periods: int, state: str, reason: str
) -> None:
    good = 240
    run, message = broken_rigs.break_rig(fault, good)

    assert message.startswith("not active" if state == "inactive" else "active")
    assert re.search(reason, message)
    assert run.command_v[:good].any()
    # The sample that shows the fault was still taken under the old command.
    assert not run.command_v[good + periods + 1 :].any()
    # A command that cannot be written shows when the next one comes.
    if fault != "write_error":
        assert (len(run.sequence) <= good + 1) == (state == "inactive")
    assert broken_rigs.graph.state_of("daq") == "inactive"
    assert len(re.findall(reason, broken_rigs.daq.printed)) == 1


def test_two_controllers___the_drive_is_held_and_both_are_named(broken_rigs: Campaign) -> None:
    graph = broken_rigs.graph
    broken_rigs.activate()
    broken_rigs.await_drive()

    rival = broken_rigs.start_controller("-r", "__node:=rival")

    graph.wait(lambda: broken_rigs.figures().get("drive") == "held", "the hold")
    # Discovery tells the name of a node after its topics.
    both = "/flexarm/controller, /flexarm/rival"
    graph.wait(lambda: broken_rigs.figures().get("commanders") == both, "both names")
    assert broken_rigs.figures()["events: two commanders"] == "1"
    assert "two commanders" in broken_rigs.status.message
    broken_rigs.await_samples(60)
    assert not any(state.command_v for state in broken_rigs.states)
    assert graph.transition("daq", "deactivate")
    graph.stop(rival)


@pytest.mark.exhaustive
def test_controller_killed_at_random_moments___drive_at_zero_within_three_periods(
    campaign: Campaign,
) -> None:
    campaign.activate()
    for kill in campaign.kill_controllers(random_moments_s(2, seed=4)):
        assert 1 <= kill.periods <= MAX_AGE_PERIODS, kill
    campaign.graph.wait(lambda: campaign.figures().get("drive") == "ready", "the report")
    assert campaign.figures()["events: two commanders"] == "0"


def test_daq_killed___bag_readable_and_others_alive(campaign: Campaign) -> None:
    campaign.start_controller()

    run = campaign.kill_daq(0.3)

    np.testing.assert_array_equal(np.diff(run.sequence), 1)
    assert run.command_v.any()
    campaign.restart_daq(DAQ)
    campaign.activate()
    campaign.await_drive()
    campaign.graph.check()


def test_node_that_raises_anywhere___says_so_in_one_line_and_shows_it_in_its_state(
    graph: Graph, tmp_path: Path
) -> None:
    process = run_script(graph, tmp_path / "failing_node.py", FAILING_NODE)

    def fail(where: str) -> None:
        graph.operator.set_parameters("failing", {"where": where})

    def complaints() -> list[str]:
        return re.findall(r"(?:not configured|not activated|ended): KeyError.*", process.printed)

    fail("configure")
    assert not graph.transition("failing", "configure")
    assert graph.state_of("failing") == "unconfigured"
    fail("activate")
    assert graph.transition("failing", "configure")
    assert not graph.transition("failing", "activate")
    assert graph.state_of("failing") == "inactive"
    fail("loop")
    assert graph.transition("failing", "activate")
    eventually(lambda: len(complaints()) == 3, "the last complaint")
    graph.await_state("failing", "inactive")
    place = r" \(failing_node\.py:\d+\)"
    for complaint, where in zip(complaints(), ("configure", "activate", "loop"), strict=True):
        assert re.fullmatch(rf".*: KeyError: '{where}'{place}", complaint)
    fail("nowhere")
    assert graph.transition("failing", "activate")
    assert graph.state_of("failing") == "active"


@pytest.mark.exhaustive
def test_clock_that_jumps___moves_no_stamp_of_a_running_loop(graph: Graph, tmp_path: Path) -> None:
    """The nodes' wall clock is a topic here, and jumps an hour forth and two back."""
    commands: list[MotorCommand] = []
    graph.node.create_subscription(MotorCommand, "command", commands.append, qos.EVERY)
    clock = graph.node.create_publisher(Clock, "/clock", qos.SENT)
    campaign = Campaign(graph, tmp_path)
    campaign.start(DAQ | {"use_sim_time": True, "time": "real"})
    graph.start("controller", {"autostart": True, "use_sim_time": True, "law": "pd"})
    graph.wait(lambda: graph.node.count_publishers("/flexarm/command") == 1, "the controller")

    def jump_to(seconds: int) -> None:
        before = len(commands)
        message = Clock()
        message.clock.sec = seconds

        def went_on() -> bool:
            clock.publish(message)
            return len(commands) > before + 100

        graph.wait(went_on, "commands after the jump")

    bag = campaign.record()
    campaign.activate()
    for seconds in (10_000, 13_600, 6_400):
        jump_to(seconds)
    assert graph.transition("daq", "deactivate")
    graph.operator.record(None)

    run = States(bag)
    # A command has the stamp of its sample.
    stamps_s = np.array([stamp_ns(command.header.stamp) * 1e-9 for command in commands])
    assert stamps_s.min() > run.stamp_s[0] - 1e-6
    assert stamps_s.max() < run.stamp_s[-1] + 1e-6
    # Periods may be missed on a busy machine, with their numbers.
    assert (np.diff(run.sequence) > 0).all()
    steps_s = np.diff(run.stamp_s)
    # An hour may not.
    assert steps_s.min() > 0.0
    assert steps_s.max() < 60.0
    assert run.stamp_s[-1] - run.stamp_s[0] < 60.0


def test_signal_while_a_thread_is_in_compiled_code___ends_the_node_in_order(
    graph: Graph, tmp_path: Path
) -> None:
    process = run_script(graph, tmp_path / "working_node.py", WORKING_NODE)
    eventually(lambda: "at work" in process.printed, "the thread")

    process.send(signal.SIGTERM)

    assert process.exit_code() == 0
    assert process.printed == "at work\n"


@pytest.mark.exhaustive
def test_loop___asks_its_readers_soon_what_they_have___so_what_is_lost_is_soon_repeated(
    graph: Graph, tmp_path: Path
) -> None:
    graph.start("controller")
    assert graph.transition("controller", "configure")
    # Without the profile of the nodes with a loop it takes 3 s. A busy machine may need more tries.
    reported = ""
    for attempt in range(3):
        process = run_script(graph, tmp_path / f"asking_node_{attempt}.py", ASKING_NODE)
        assert process.exit_code() == 0, process.printed
        reported += process.printed
        if "reader known: True, acknowledged: True" in reported:
            return
    pytest.fail(reported)
