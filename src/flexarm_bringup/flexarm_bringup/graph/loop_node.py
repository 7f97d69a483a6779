"""The nodes `daq` and `controller` in one process, for 1 and 2 kHz.

A sample reaches the law without the middleware. Parameters, services, topics and lifecycle are
those of the two nodes in two processes, and every message is published as there.

Each node has an executor in a thread of its own: a change of the control law, whose design takes
long, does not keep an emergency stop waiting.
"""

from __future__ import annotations

import sys
import threading
import traceback
from typing import TYPE_CHECKING

from rclpy.executors import SingleThreadedExecutor

from flexarm_control.controller_node import ControllerNode
from flexarm_core.errors import SettingError
from flexarm_daq.nodes.daq_node import DaqNode
from flexarm_node.parameter_files import BEGIN, LOOP, own_words
from flexarm_node.process import request_stop, run
from flexarm_node.topics.handover import DirectHandover

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.node import Node

    Arguments = dict[str, list[str]]

_END_S = 2.0
# Python's own 5 ms would keep the next sample waiting that long for a thread that computes.
_SWITCH_S = 5e-5


def node_arguments(words: Sequence[str]) -> Arguments:
    """Return the ROS arguments of each node, from words that are not ROS arguments of both.

    Parameters
    ----------
    words : sequence of str
        Command line: `daq.rate_hz:=1000.0 controller.law:=pdpc --ros-args -r __ns:=/arm2`.

    Raises
    ------
    SettingError
        When a word is not a parameter of one of the nodes.
    """
    arguments: Arguments = {name: [] for name in LOOP}
    for word in own_words(words):
        name, _, assignment = word.partition(".")
        if name not in arguments or ":=" not in assignment:
            raise SettingError(
                f"{word!r} is not a parameter, such as daq.rate_hz:=1000.0: outside of {BEGIN} "
                f"each names its node, {' or '.join(LOOP)}, and has no -p"
            )
        arguments[name] += [BEGIN, "-p", assignment] if not arguments[name] else ["-p", assignment]
    return arguments


class SpunBeside:
    """Executor of a node in a thread of its own.

    Parameters
    ----------
    node : Node
        The node.

    Attributes
    ----------
    failure : str
        Error of one of the node's callbacks, which asks the process to stop; "" without one.
    """

    def __init__(self, node: Node) -> None:
        self.failure = ""
        self._stopped = threading.Event()
        # Its callback ends `spin_once`.
        self._stop = node.create_guard_condition(self._stopped.set)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, daemon=True, name="executor")
        self._thread.start()

    def end(self) -> bool:
        """End the spinning; return False when a callback does not end in time."""
        self._stop.trigger()
        self._thread.join(_END_S)
        if self._thread.is_alive():
            return False
        self._executor.shutdown()
        return True

    def _spin(self) -> None:
        try:
            while not self._stopped.is_set():
                self._executor.spin_once()
        except Exception as error:  # noqa: BLE001 - in a process of its own it would end that
            self.failure = str(error) or type(error).__name__
            traceback.print_exc()
            request_stop()


class LoopNode(DaqNode):
    """DAQ node, with the controller beside it.

    Parameters
    ----------
    arguments : dict of str to list of str
        ROS arguments of each node.
    """

    def __init__(self, arguments: Arguments) -> None:
        handover = DirectHandover()
        super().__init__(handover, arguments["daq"])
        try:
            self._controller = ControllerNode(handover, arguments["controller"])
        except BaseException:
            # It may be driving already.
            super().stop()
            raise
        self._beside = SpunBeside(self._controller)
        self._beside_ended = False

    @property
    def failure(self) -> str:
        """Error of the controller that ended the process; "" without one."""
        return self._beside.failure

    def stop(self) -> None:
        """Take the drive to zero, before anything else is ended."""
        super().stop()
        self._beside_ended = self._beside.end()
        self._controller.stop()

    def destroy_node(self) -> None:
        """Destroy both nodes."""
        if self._beside_ended:
            self._controller.destroy_node()
        super().destroy_node()


def main() -> int:
    """Run both nodes."""
    sys.setswitchinterval(_SWITCH_S)
    return run(lambda: LoopNode(node_arguments(sys.argv[1:])), realtime=True, takes_words=True)
