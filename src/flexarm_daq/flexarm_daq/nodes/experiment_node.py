"""Experiment node: answers every sample of `state` with a command of an open-loop experiment.

The node is a managed node that takes the controller's place on `command`. It sends no compensation:
the effort is the whole command (2.4.1, 2.4.2). It declares that its commands do not use the
outputs. The reversal at the bound is a guard that acts a few times in a record, not a loop around
the arm.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexarm_core.channels import BOUND_V, MAX_COMMAND_V
from flexarm_core.tables import read_table
from flexarm_daq.experiments.excitation import EXCITATIONS, Excitation
from flexarm_node.answering_node import AnsweringNode
from flexarm_node.process import run

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flexarm_node.topics.layout import Numbers

PARAMETERS = read_table(
    "flexarm_daq.nodes",
    "experiment",
    {"excitations": tuple(EXCITATIONS), "max_command_v": MAX_COMMAND_V},
)


def _excitation(values: Mapping[str, Any]) -> Excitation:
    return EXCITATIONS[values["waveform"]](values["magnitude_v"], values["seed"])


class ExperimentNode(AnsweringNode):
    """Node that connects parameters and topics to an excitation."""

    def __init__(self) -> None:
        super().__init__("experiment", PARAMETERS, accept=_excitation)
        self.start_if_asked()

    def commander(self) -> tuple[str, bool]:
        """Return the waveform, which uses no outputs."""
        return self.parameters.values()["waveform"], False

    def prepare(self) -> None:
        """Make the excitation; parameters that change later act in the next run."""
        self._excitation = _excitation(self.parameters.values())
        super().prepare()

    def begin(self) -> None:
        """Begin the experiment again from the start."""
        self._excitation.reset()

    def answer(self, state: Numbers, taken_ns: int) -> tuple[float, float]:
        """Return the command, which is effort alone."""
        time_s = (taken_ns - self.run_start_ns) * 1e-9
        return self._excitation.step(time_s, state.position_v), 0.0

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        yield {"waveform": self.parameters.values()["waveform"], "bound V": BOUND_V}
        yield from super().figures()


def main() -> int:
    """Run the node."""
    return run(ExperimentNode, realtime=True)
