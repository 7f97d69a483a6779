"""DAQ node and controller in one process: the record and the safety of two."""

from __future__ import annotations

import re
import signal
import time
from typing import TYPE_CHECKING, Any

import pytest
from std_srvs.srv import Trigger

from flexarm_ident.provenance import samples_hash
from flexarm_ident.reading.read import read_bag
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.exhaustive import wide
from support.recorded_samples import declarations
from support.system_graph import Graph, executable, ros_arguments

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Process

pytestmark = pytest.mark.system

DAQ = {"rate_hz": 1000.0, "seed": 7}
# A set-point that stays away from the arm, so that the command never is zero by itself.
CONTROLLER = {
    "law": "pd",
    "pd.compensation_v": 0.7,
    "reference": "square",
    "square.period_s": 0.4,
}


def start_composed(graph: Graph, daq: dict[str, Any]) -> Process:
    """Start both nodes as one process, configured."""
    words = [f"daq.{name}:={value}" for name, value in daq.items()]
    words += [f"controller.{name}:={value}" for name, value in CONTROLLER.items()]
    process = graph.run([str(executable("loop")), *words, *ros_arguments({})])
    graph.configure_loop()
    return process


def recorded(graph: Graph, folder: Path, name: str) -> list[tuple[str, list[float], Any]]:
    """Record a run at each pace; return the hash of its samples, its set-points, and who commanded.

    As fast as it goes, the sampling thread of one process runs the law itself.
    """
    runs = []
    for pace in wide((0.0,), (0.0, 50.0)):
        graph.operator.set_parameters("daq", {"real_time_factor": pace})
        bag = folder / f"{name}_{pace:.0f}"
        graph.operator.recorded_run("controller", str(bag), 600, lambda _: None)
        record = read_bag(bag)
        assert record.reference is not None
        runs.append((samples_hash(record), record.reference.tolist(), declarations(bag)))
    return runs


def end(process: Process, *signals: signal.Signals) -> None:
    """End the process while it drives, and look at what it says."""
    process.send(*signals)
    assert process.exit_code() == 0
    assert re.search(r"\d samples?, the drive is at zero", process.printed)
    assert "Traceback" not in process.printed


def test_record___of_one_process___is_that_of_two(graph: Graph, tmp_path: Path) -> None:
    graph.start("recorder")
    nodes = [graph.start("controller", CONTROLLER), graph.start("daq", DAQ)]
    graph.configure_loop()
    graph.operator.await_recorder()
    two = recorded(graph, tmp_path, "two")
    for node in nodes:
        assert graph.stop(node) == 0

    composed = start_composed(graph, DAQ)
    one = recorded(graph, tmp_path, "one")
    end(composed, signal.SIGINT)

    assert one == two


def test_composed_loop___emergency_stop_standstill_and_end___zero_and_a_report(
    graph: Graph,
) -> None:
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    composed = start_composed(graph, {"rate_hz": 300.0, "time": "real"})
    graph.operator.activate("controller")
    assert graph.transition("daq", "activate")
    graph.wait(lambda: bool(states) and states[-1].command_v != 0.0, "a driven arm")

    assert graph.call(Trigger, "emergency_stop", Trigger.Request()).success
    states.clear()
    graph.wait(lambda: len(states) >= 300, "samples after the stop")
    assert not any(state.command_v for state in states[150:])

    assert graph.transition("daq", "deactivate")
    assert graph.transition("daq", "activate")
    states.clear()
    graph.wait(lambda: any(state.command_v for state in states), "a driven arm again")
    assert graph.transition("controller", "deactivate")
    graph.wait(lambda: not states[-1].command_v, "zero without a commander")
    graph.operator.activate("controller")
    graph.wait(lambda: states[-1].command_v != 0.0, "a driven arm for the third time")
    composed.send(signal.SIGSTOP)
    # The length of the standstill, which is the fault, and no deadline.
    time.sleep(0.3)
    composed.send(signal.SIGCONT)
    graph.wait(lambda: "in all: the loop was held up" in composed.printed, "words of it")
    # Under a launcher a node gets two.
    end(composed, signal.SIGINT, signal.SIGTERM)


def test_composed_loop___wrong_parameter_of_the_controller___ends_with_a_line(
    graph: Graph,
) -> None:
    process = graph.run([str(executable("loop")), "controller.lawn:=pd", *ros_arguments({})])
    assert process.exit_code() == 2
    assert "/flexarm/controller has no parameter lawn (nearest: law)" in process.printed
