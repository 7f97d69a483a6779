"""Nodes of a user's own beside flexarm's: those of `examples`, run as the page on them says."""

from __future__ import annotations

import re
import signal
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.recorded_samples import States, declarations
from support.system_graph import ROOT, Graph, Process

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

pytestmark = pytest.mark.system

CONTROLLER = ("/flexarm/controller", "pdpc", True)
OWN = ("/flexarm/own_commander", "own_pd", True)


def example(graph: Graph, name: str) -> Process:
    """Start a program of `examples`."""
    return graph.run([sys.executable, "-u", str(ROOT / "examples" / f"{name}.py")])


def figures(pattern: str, process: Process) -> list[float]:
    """Return the numbers that a pattern catches in what a program printed."""
    found = re.search(pattern, process.printed)
    assert found, process.printed
    return [float(each) for each in found.groups()]


class Loop:
    """Simulated arm under its controller, and its record."""

    def __init__(self, graph: Graph, bag: Path) -> None:
        self.graph, self.bag = graph, bag
        self.newest = ArmState()
        graph.node.create_subscription(ArmState, "state", self.hear, qos.NEWEST)
        self.recorder = graph.start("recorder", {"bag": str(bag)})
        graph.start("controller", {"law": "pdpc"})
        graph.start("daq")
        graph.activate_loop()
        graph.operator.start_sampling()

    def hear(self, state: ArmState) -> None:
        """Keep the newest sample."""
        self.newest = state

    def end_of(self, process: Process) -> int:
        """Wait for the end of a program and return its code."""
        self.graph.wait(lambda: process.popen.poll() is not None, "the end of the example")
        return process.exit_code()

    def recorded(self) -> States:
        """End the run and return its samples."""
        for name in ("daq", "controller"):
            assert self.graph.transition(name, "deactivate")
        assert self.graph.stop(self.recorder) == 0
        return States(self.bag)

    def set_points(self) -> NDArray[np.float64]:
        """Return the recorded set-points, V."""
        with AnyReader([self.bag]) as reader:
            connections = [
                each for each in reader.connections if each.topic == "/flexarm/reference"
            ]
            messages: list[Any] = [
                reader.deserialize(raw, connection.msgtype)
                for connection, _, raw in reader.messages(connections)
            ]
        return np.array([message.data for message in messages])


@pytest.fixture
def loop(graph: Graph, tmp_path: Path) -> Loop:
    return Loop(graph, tmp_path / "bag")


@pytest.mark.exhaustive
def test_own_reference___smooth_move___arrives_and_the_arm_follows(loop: Loop) -> None:
    process = example(loop.graph, "own_reference")

    assert loop.end_of(process) == 0, process.printed
    sent, _ = figures(r"(\d+) set-points in (\S+) s", process)
    largest_v, mean_v = figures(r"largest (\S+) V, mean (\S+) V", process)
    states, set_points = loop.recorded(), loop.set_points()
    # The controller tells its own before, 0 V. A recorder that hears of the node later than the
    # controller misses the first ones.
    given = set_points[set_points != 0.0]
    assert 0.8 * sent < len(given) <= sent
    assert (np.diff(given) >= 0.0).all()
    assert given[-1] - given[0] == pytest.approx(2.0, abs=0.1)
    # The law's band at rest, and the lag of a move at up to 0.8 V/s.
    assert states.volts[-30:, 0].mean() == pytest.approx(given[-1], abs=0.1)
    assert 0.0 < mean_v < largest_v < 1.0


def test_own_reference___without_samples___says_so(graph: Graph) -> None:
    process = example(graph, "own_reference")

    assert process.exit_code() == 1
    assert "no samples: does ./flexarm up run in this ROS domain?" in process.printed


@pytest.mark.exhaustive
def test_own_commander___drives_the_arm_by_accepted_commands_and_gives_its_place_back(
    loop: Loop,
) -> None:
    loop.graph.wait(lambda: loop.newest.command_sequence > 0, "a command of the controller")
    process = example(loop.graph, "own_commander")

    assert loop.end_of(process) == 0, process.printed
    assert "the controller is back" in process.printed
    own, obeyed = figures(r"(\d+) commands, (\d+) samples with one in force", process)
    # The controller began with number 1 too, and the last ones are not seen to be obeyed.
    assert own - 5 <= obeyed < own
    assert loop.graph.state_of("controller") == "active"
    loop.graph.wait(lambda: 0 < loop.newest.command_sequence < own, "the controller in force")
    states = loop.recorded()
    assert declarations(loop.bag) == [CONTROLLER, OWN, CONTROLLER]
    # In virtual time each sample has the command that answers the one before.
    in_force = states.command_sequence > 0
    begins = np.flatnonzero(in_force[1:] & ~in_force[:-1])
    assert len(begins) == 3
    of_own = slice(begins[1] + 1, begins[1] + 1 + int(obeyed))
    numbers = states.command_sequence[of_own]
    assert numbers[0] <= own - obeyed + 1
    # While the place changes hands a sample may have its answer from neither.
    assert (np.diff(numbers[1:]) == 1).all()
    assert np.abs(states.command_v[of_own]).max() > 0.5
    assert states.volts[of_own][-30:, 0].mean() == pytest.approx(1.5, abs=0.1)


@pytest.mark.exhaustive
def test_own_commander___interrupted___gives_its_place_back(loop: Loop) -> None:
    process = example(loop.graph, "own_commander")
    loop.graph.await_state("controller", "inactive")
    loop.graph.wait(lambda: loop.newest.position_v > 0.5, "a move by the example")

    process.send(signal.SIGINT)

    assert loop.end_of(process) == 0, process.printed
    assert "the controller is back" in process.printed
    assert loop.graph.state_of("controller") == "active"
