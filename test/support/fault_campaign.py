"""Faults on live nodes: processes killed at random moments, and broken rigs.

Whether the drive went to zero is read from the samples: each one carries the command in force while
it was taken. Time is counted in the samples of the DAQ node, since the machine may be busy.
"""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from flexarm_bringup.graph.processes import LaunchError
from flexarm_node import qos
from flexarm_node.stamps import stamp_ns
from support.heard_states import HeardStates
from support.recorded_samples import States
from support.system_graph import Graph, eventually

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from flexarm_msgs.msg import ArmState
    from support.system_graph import Process

# A step whose error stays, so that the command never is zero by itself.
RESTLESS = {"law": "pd", "reference": "square", "square.period_s": 0.4, "pd.compensation_v": 0.7}
MAX_AGE_PERIODS = 3
"""Default age of a command at which the DAQ node sets the drive to zero."""
QUIET_SAMPLES = 60
_LONGEST_WAIT_S = 0.4


@dataclass(frozen=True)
class Kill:
    """Outcome of one killed controller.

    `periods` counts the samples at which its last command was in force.
    """

    moment_s: float
    periods: int


class Campaign:
    """Graph whose nodes are given faults.

    Parameters
    ----------
    graph
        The graph, empty.
    folder
        Gets the bags.
    """

    def __init__(self, graph: Graph, folder: Path) -> None:
        self.graph = graph
        self._folder = folder
        self._heard = HeardStates(graph.node)
        self.status = DiagnosticStatus()
        self._bags = 0
        self._reports_from_ns = 0
        self._batches = count()
        graph.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, qos.EVERY)

    @property
    def states(self) -> list[ArmState]:
        """Samples since the last wait for some began."""
        return self._heard.all()

    def figures(self) -> dict[str, str]:
        """Return the newest figures of the DAQ node."""
        return {each.key: each.value for each in self.status.values}

    def start(self, daq: Mapping[str, object]) -> None:
        """Start recorder and DAQ node, and configure the DAQ node."""
        self.graph.start("recorder")
        self.daq = self.graph.start("daq", daq)
        assert self.graph.transition("daq", "configure")

    def start_controller(self, *more: str) -> Process:
        """Start a controller that answers at once."""
        return self.graph.start("controller", RESTLESS | {"autostart": True}, *more)

    def await_drive(self) -> None:
        """Wait until the arm is driven."""
        self._heard.forget()

        def is_driven() -> bool:
            assert self.status.level != DiagnosticStatus.ERROR, self.status.message
            return any(state.command_v for state in self.states)

        self._wait(is_driven, "a driven arm")

    def activate(self) -> None:
        """Activate the DAQ node; what it has reported before is forgotten."""
        self.graph.operator.activate("daq")
        # An earlier report, of an earlier fault, may still be on its way.
        self._reports_from_ns = time.time_ns()
        self.status = DiagnosticStatus()

    def warm_up(self) -> None:
        """Let the DAQ node drive the arm once: then everybody has heard of everybody."""
        self.activate()
        self.await_drive()
        assert self.graph.transition("daq", "deactivate")

    def await_samples(self, samples: int) -> None:
        """Wait for more samples."""
        self._heard.forget()
        self._wait(lambda: len(self.states) >= samples, "samples")

    def record(self) -> Path:
        """Start to record into a new bag."""
        self._bags += 1
        bag = self._folder / f"bag_{self._bags}"
        self.graph.operator.record(str(bag))
        return bag

    def kill_controllers(self, moments_s: Sequence[float]) -> Iterator[Kill]:
        """Kill one controller after the other, each after some time of driving.

        All are started at once: the discovery of a new process beside killed ones takes long. The
        DAQ node is active before and after.
        """
        started = next(self._batches)
        names = [f"controller_{started}_{number}" for number in range(len(moments_s))]
        processes = [
            self.graph.start("controller", RESTLESS, "-r", f"__node:={name}") for name in names
        ]
        for name in names:
            assert self.graph.transition(name, "configure")
        for name, process, moment_s in zip(names, processes, moments_s, strict=True):
            bag = self.record()
            assert self.graph.transition(name, "activate")
            self.await_drive()
            self.spin(moment_s)
            assert self.graph.stop(process, signal.SIGKILL) == -signal.SIGKILL
            self._wait(self._is_quiet, "the drive at zero")
            self.graph.operator.record(None)
            assert np.all(np.diff(States(bag).sequence) > 0), "the bag goes back"
            yield _after_kill(self.states, moment_s)

    def break_rig(self, fault: str, after_samples: int) -> tuple[States, str]:
        """Activate with a fault of the rig; return the bag and what the diagnostics say.

        The DAQ node is inactive before and after.
        """
        self.graph.operator.set_parameters(
            "daq", {"fault": fault, "fault_after_samples": after_samples}
        )
        bag = self.record()
        self.activate()
        self.graph.wait(lambda: self.status.level == DiagnosticStatus.ERROR, "an alarm")
        message = str(self.status.message)
        if self.graph.operator.is_active("daq"):
            # A loop that has ended may deactivate the node between question and request.
            done = self.graph.transition("daq", "deactivate")
            assert done or self.graph.state_of("daq") == "inactive"
        self.graph.operator.record(None)
        self.graph.operator.set_parameters("daq", {"fault": "none"})
        return States(bag), message

    def kill_daq(self, moment_s: float) -> States:
        """Kill the DAQ node while it drives, and read the bag of what it had published."""
        bag = self.record()
        self.activate()
        self.await_drive()
        self.spin(moment_s)
        assert self.graph.stop(self.daq, signal.SIGKILL) == -signal.SIGKILL
        self.graph.operator.record(None)
        return States(bag)

    def stop_daq(self, stop: signal.Signals) -> int:
        """End the DAQ node by a signal while it drives; return its exit code."""
        self.activate()
        self.await_drive()
        return self.graph.stop(self.daq, stop)

    def restart_daq(self, daq: Mapping[str, object]) -> None:
        """Start another DAQ node in place of the one that has ended."""
        eventually(lambda: self.daq.popen.poll() is not None, "the end of the DAQ node")
        self.daq = self.graph.start("daq", daq)
        assert self.graph.transition("daq", "configure")

    def spin(self, length_s: float) -> None:
        """Let time pass: the moment of the fault, not a deadline."""
        until_s = time.monotonic() + length_s
        self.graph.wait(lambda: time.monotonic() >= until_s, "the moment")

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        try:
            self.graph.wait(condition, what)
        except LaunchError as error:
            reported = f"{len(self.states)} samples, {self.status.message}, {self.figures()}"
            raise AssertionError(f"{error}: {reported}") from None

    def _is_quiet(self) -> bool:
        last = self.states[-QUIET_SAMPLES:]
        return len(last) == QUIET_SAMPLES and not any(state.command_v for state in last)

    def _on_report(self, message: DiagnosticArray) -> None:
        if stamp_ns(message.header.stamp) < self._reports_from_ns:
            return
        for status in message.status:
            if status.name.endswith("daq"):
                self.status = status


def random_moments_s(count: int, seed: int) -> list[float]:
    """Return moments for the kills, from the first command on."""
    return [float(each) for each in np.random.default_rng(seed).uniform(0, _LONGEST_WAIT_S, count)]


def _after_kill(states: Sequence[ArmState], moment_s: float) -> Kill:
    """Look at the samples from the controller's last command on; the last ones are at zero."""
    driven = [state for state in states if state.command_v]
    last = driven[-1].command_sequence
    return Kill(moment_s, sum(state.command_sequence == last for state in driven))
