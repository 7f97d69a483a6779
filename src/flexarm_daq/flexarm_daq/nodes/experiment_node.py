"""Experiment node: answers every sample of the rig with a command of an open-loop experiment.

The node is a managed node that takes the controller's place. It sends no compensation:
the effort is the whole command (2.4.1, 2.4.2). It declares that its commands do not use the
outputs. The reversal at the bound is a guard that acts a few times in a record, not a loop around
the arm.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_core.channels import BOUND_V, MAX_COMMAND_V, TRAVEL_V, is_thesis_arm
from flexarm_core.errors import SettingError, nearest
from flexarm_core.specs import select
from flexarm_core.tables import defaults, read_table
from flexarm_core.waves import Band
from flexarm_daq.experiments.excitation import EXCITATIONS, Excitation
from flexarm_node.answering_node import AnsweringNode
from flexarm_node.process import run

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from flexarm_core.rig_description import RigDescription
    from flexarm_core.signals import Sample
    from flexarm_node.answering_node import Answer

PARAMETERS = read_table(
    "flexarm_daq.nodes",
    "experiment",
    {"excitations": tuple(EXCITATIONS), "max_command_v": MAX_COMMAND_V, **defaults(Band())},
)


# Inputs beyond the first take a waveform at another pace, by so many parts of the first one's.
_PACE = 7
# Their seeds tell those of a multisine apart, whose period a pace would change.
_EVEN_PACE = frozenset({"multisine", "pulses"})


def _excitation(values: Mapping[str, Any], number: int = 0) -> Excitation:
    make = EXCITATIONS[values["waveform"]]
    return make(values["magnitude_v"], values["seed"] + number, select(Band, values))


class Driven(NamedTuple):
    """Excitation of one input: the waveforms are in volts of the thesis's arm.

    Attributes
    ----------
    excitation : Excitation
        The waveform.
    pace : float
        Its time in that of the arm.
    rest, per_volt : float
        Command at rest, and change of it for 1 V of the waveform.
    place : int or None
        Output with the position of the joint.
    middle, volts_per_unit : float
        Middle of its travel, and volts of the thesis's position for one unit of it.
    """

    excitation: Excitation
    pace: float
    rest: float = 0.0
    per_volt: float = 1.0
    place: int | None = 0
    middle: float = 0.0
    volts_per_unit: float = 1.0

    def effort(self, time_s: float, outputs: Sequence[float]) -> float:
        """Return the command of the input at a sample."""
        position = self.middle if self.place is None else outputs[self.place]
        angle_v = self.volts_per_unit * (position - self.middle)
        return self.rest + self.per_volt * self.excitation.step(time_s * self.pace, angle_v)


def driven_inputs(rig: RigDescription, values: Mapping[str, Any]) -> tuple[Driven, ...]:
    """Return the excitation of each input: its limits stand for 10 V, its travel for 6.857 V.

    Raises
    ------
    SettingError
        When the one input that is to be driven is none of the rig's.
    """
    only = values["input"]
    if only and only not in rig.input_names:
        raise SettingError(
            f"input = {only!r}: rig {rig.name} has {', '.join(rig.input_names)}"
            f"{nearest(only, rig.input_names)}"
        )
    if is_thesis_arm(rig):
        return (Driven(_excitation(values), 1.0),)
    joints = {each.input: each for each in rig.joints}
    found = []
    for number, each in enumerate(rig.inputs):
        driven = Driven(
            _excitation(values, number),
            1.0 if values["waveform"] in _EVEN_PACE else 1.0 + number / _PACE,
            rest=each.rest,
            per_volt=each.reach / MAX_COMMAND_V if only in {"", each.name} else 0.0,
            place=None,
        )
        if joint := joints.get(each.name):
            driven = driven._replace(
                place=rig.output_names.index(joint.angle),
                middle=joint.middle,
                volts_per_unit=joint.sign * TRAVEL_V / joint.half_travel,
            )
        found.append(driven)
    return tuple(found)


class ExperimentNode(AnsweringNode):
    """Node that connects parameters and topics to an excitation."""

    def __init__(self) -> None:
        super().__init__("experiment", PARAMETERS, accept=_excitation, expected=(SettingError,))
        self.start_if_asked()

    def commander(self) -> tuple[str, bool]:
        """Return the waveform, which uses no outputs."""
        return self.parameters.values()["waveform"], False

    def prepare(self) -> None:
        """Make the excitation; parameters that change later act in the next run."""
        self._driven = driven_inputs(self.description, self.parameters.values())
        super().prepare()

    def begin(self) -> None:
        """Begin the experiment again from the start."""
        for each in self._driven:
            each.excitation.reset()

    def answer(self, sample: Sample) -> Answer:
        """Return the commands, which are effort alone."""
        time_s = (sample.taken_ns - self.run_start_ns) * 1e-9
        efforts = tuple(each.effort(time_s, sample.outputs) for each in self._driven)
        return efforts, (0.0,) * len(efforts)

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        yield {"waveform": self.parameters.values()["waveform"]}
        for each in self._driven:
            if each.place is not None:
                angle = self.description.outputs[each.place]
                bound = each.middle + BOUND_V / abs(each.volts_per_unit)
                yield {f"bound {angle.name}": angle.text(bound)}
        yield from super().figures()


def main() -> int:
    """Run the node."""
    return run(ExperimentNode, realtime=True)
