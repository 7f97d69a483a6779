"""The exciter: answers every sample of `state` with a command of an open-loop experiment.

A managed node that takes the controller's place on `command`. It carries no compensation: what is
sent is the whole command (2.4.1, 2.4.2). It declares that its commands do not use the outputs: the
turning round at the bound is a guard that acts a few times in a record, not a loop around the arm.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexarm_core.specs import ParameterSpec
from flexarm_daq.experiments.excitation import BOUND_V, EXCITATIONS, Excitation
from flexarm_msgs.msg import ArmState, CommanderInfo, MotorCommand
from flexarm_node import qos
from flexarm_node.loop_node import LoopNode
from flexarm_node.process import run
from flexarm_node.stamps import set_stamp, stamp_ns
from flexarm_node.waiting import TopicWaiter

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Mapping

_WAIT_S = 0.1

PARAMETERS = (
    ParameterSpec("waveform", "square", "the excitation", choices=tuple(EXCITATIONS)),
    ParameterSpec(
        "magnitude_v", 1.0, "magnitude; the largest one when it is random", 0.0, 10.0, "V"
    ),
    ParameterSpec("seed", 0, "seed of what is random", 0, 2**31 - 1),
)


def _excitation(values: Mapping[str, Any]) -> Excitation:
    return EXCITATIONS[values["waveform"]](values["magnitude_v"], values["seed"])


class ExperimentNode(LoopNode):
    """Wires parameters and topics to an excitation."""

    def __init__(self) -> None:
        super().__init__("experiment", PARAMETERS, accept=_excitation)
        self._answered = 0
        self.start_if_asked()

    def make_topics(self) -> None:
        """Make the topics of the loop."""
        self._states: TopicWaiter[Any] = TopicWaiter(self, ArmState, "state", qos.NEWEST)
        self._commands = self.create_publisher(MotorCommand, "command", qos.SENT)
        self._commander = self.create_publisher(CommanderInfo, "commander", qos.STATUS)

    def release_topics(self) -> None:
        """Give the topics back."""
        self._states.close()
        self.destroy_publisher(self._commands)
        self.destroy_publisher(self._commander)

    def prepare(self) -> None:
        """Make the excitation, wait for every reader of the commands, drop an old sample.

        And tell what will command.
        """
        values = self.parameters.values()
        self._excitation = _excitation(values)
        self.await_listeners(self._commands, least=1)
        self._states.wait_newest(0.0)
        info = CommanderInfo(
            node=self.get_fully_qualified_name(), law=values["waveform"], uses_outputs=False
        )
        info.header.stamp = self.get_clock().now().to_msg()
        self._commander.publish(info)

    def loop(self, stopping: threading.Event) -> None:
        """Answer until told to stop; a new run of samples begins the experiment anew."""
        last_sequence, start_ns = 0, 0
        command = MotorCommand()
        command.header.frame_id = "flexarm"
        while not stopping.is_set():
            state = self._states.wait_newest(_WAIT_S)
            if state is None:
                self.spare_time()
                continue
            taken_ns = stamp_ns(state.header.stamp)
            if state.sequence <= last_sequence or last_sequence == 0:
                start_ns = taken_ns
                self._excitation.reset()
            last_sequence = state.sequence
            set_stamp(command.header.stamp, self.get_clock().now().nanoseconds)
            command.sequence += 1
            command.state_sequence = state.sequence
            command.effort_v = self._excitation.step((taken_ns - start_ns) * 1e-9, state.position_v)
            self._commands.publish(command)
            self._answered += 1
            self.spare_time()
        # A recorder shall have every command before the run counts as ended.
        self.await_acknowledged(self._commands, self._commander)

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        yield {
            "waveform": self.parameters.values()["waveform"],
            "bound V": BOUND_V,
            "answered samples": self._answered,
        }


def main() -> int:
    """Run the node."""
    return run(ExperimentNode, realtime=True)
