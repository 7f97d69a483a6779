"""The DAQ node on a board: the real node process, with the double of `nidaqmx` in its path."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest

from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph, Process

pytestmark = pytest.mark.system

TEST_FOLDER = PROJECT / "test"
RESTLESS = {"law": "pd", "reference": "square", "square.period_s": 0.4, "pd.compensation_v": 0.7}

# Writes to the outputs outlive the process in a file; the file `removed` pulls the board out.
PACKAGE = """
import sys
from pathlib import Path
from support.nidaq_board import Board, PatientClock
from support.nidaqmx_double import NidaqmxDouble

here = Path({folder!r})
log = (here / "writes").open("a", buffering=1)
board = Board(clock=PatientClock())
board.on_write = lambda write: print(write.channel, write.volts, file=log)
wiring = here / "wiring"
if wiring.exists():
    signs = [float(sign) for sign in wiring.read_text().split()]
    board.sensors = lambda volts: volts * signs
double = NidaqmxDouble(board)
passed = double.call

def call(site):
    double.removed = (here / "removed").exists()
    passed(site)

double.call = call
for name in ("constants", "errors", "stream_readers", "stream_writers", "system"):
    globals()[name] = sys.modules["nidaqmx." + name] = getattr(double, name)
Task = double.Task
"""


def plug_in(graph: Graph, folder: Path) -> None:
    """Put the double where the node finds the package."""
    package = folder / "packages" / "nidaqmx"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(PACKAGE.format(folder=str(folder)))
    paths = [str(package.parent), str(TEST_FOLDER), graph.environment.get("PYTHONPATH", "")]
    graph.environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))


def writes(folder: Path) -> list[tuple[str, float]]:
    lines = (folder / "writes").read_text().splitlines()
    return [(line.split()[0], float(line.split()[1])) for line in lines]


def start(graph: Graph) -> tuple[Process, list[ArmState]]:
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    graph.start("controller", RESTLESS)
    daq = graph.start("daq", {"rig": "nidaq", "rate_hz": 300.0})
    graph.activate_loop()
    return daq, states


def test_board___loop_runs_and_a_signal_leaves_zero(graph: Graph, tmp_path: Path) -> None:
    plug_in(graph, tmp_path)
    daq, states = start(graph)
    assert graph.transition("daq", "activate"), daq.printed
    graph.wait(
        lambda: len(states) >= 300 and states[-1].command_v != 0.0, "a driven arm on the board"
    )
    assert graph.stop(daq, signal.SIGTERM) == 0

    assert "self-test: every channel answers with the right sign" in daq.printed
    held = {"Dev1/ao0": 0.0, "Dev1/ao1": 0.0}
    turns = 0
    for channel, volts in writes(tmp_path):
        if channel == "Dev1/ao1" and volts != held[channel]:
            turns += 1
            assert held["Dev1/ao0"] == 0.0
        held[channel] = volts
    # The two pulses of the self-test, and what the controller did.
    assert turns >= 3
    assert held["Dev1/ao0"] == 0.0


def test_wrong_sign___is_not_activated_and_the_reason_is_one_line(
    graph: Graph, tmp_path: Path
) -> None:
    plug_in(graph, tmp_path)
    (tmp_path / "wiring").write_text("1 1 -1 1")
    daq = graph.start("daq", {"rig": "nidaq"})
    assert graph.transition("daq", "configure")
    assert not graph.transition("daq", "activate")
    assert graph.state_of("daq") == "inactive"
    daq.wait_for("not activated")
    # The operator may ask twice on a busy machine: each refusal is one line.
    lines = [line for line in daq.printed.splitlines() if "not activated" in line]
    assert lines
    assert all(
        "middle_strain_v (ACH2) answers the current with the wrong sign" in line for line in lines
    )
    assert writes(tmp_path)[-1] == ("Dev1/ao0", 0.0)

    assert "needs a simulated rig" in graph.refusal("daq", {"time": "virtual"})
    assert "names no board" in graph.refusal("daq", {"nidaq.device": ""})
    assert "max_command_v of 2 or more" in graph.refusal("daq", {"max_command_v": 1.0})
    assert not graph.refusal("daq", {"max_command_v": 1.0, "self_test": "off"})


@pytest.mark.exhaustive
def test_board_pulled_out___node_stops_sampling_and_says_the_drive_may_be_driven(
    graph: Graph, tmp_path: Path
) -> None:
    plug_in(graph, tmp_path)
    daq, states = start(graph)
    assert graph.transition("daq", "activate"), daq.printed
    graph.wait(lambda: len(states) >= 100, "samples of the board")
    (tmp_path / "removed").touch()
    graph.await_state("daq", "inactive")
    daq.wait_for("press the emergency stop")
    assert "-201003" in daq.printed
