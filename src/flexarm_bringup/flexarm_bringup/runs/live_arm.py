"""Arm on its nodes: each measurement is a bag, and none is made twice."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import recorded_topics, running_graph
from flexarm_bringup.runs.recorded_run import new_record, record_run, workplace
from flexarm_control.commissioning.answers import judge_pulses, require_all_answer
from flexarm_control.commissioning.programme import Programme
from flexarm_core.channels import is_thesis_arm
from flexarm_ident.reading.read import read_bag

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.graph.processes import NodeProcesses
    from flexarm_bringup.runs.pace import Pace
    from flexarm_control.commissioning.answers import PulseAnswer
    from flexarm_control.commissioning.programme import Measurement
    from flexarm_core.rig_description import RigDescription
    from flexarm_ident.records.iodata import IoData

_NODES = ("recorder", "controller", "experiment", "daq")


class Arm(Protocol):
    """Where measurements are made; `delay_s` is the delay of its loop, s."""

    delay_s: float

    def bag(self, name: str) -> Path:
        """Return the place of a bag."""

    def measured(self, wanted: Measurement) -> IoData:
        """Return the record of a measurement, which is made unless its bag is there."""

    def record(self, name: str) -> IoData:
        """Return the record in a bag."""

    def forget(self, name: str) -> None:
        """Remove a bag."""

    def set_references(self, values: Mapping[str, float]) -> None:
        """Give the controller set-points by output."""


class LiveArm:
    """Arm on running nodes.

    Parameters
    ----------
    operator : Operator
        Operator of the graph.
    rig : RigDescription
        The arm.
    folder : Path
        Folder of the bags.
    processes : NodeProcesses, optional
        The nodes, where they are one's own.

    Attributes
    ----------
    operator, processes : Operator, NodeProcesses
        As given.
    delay_s : float
        Delay of the loop in the last run, s; 0 in virtual time, which waits for each command.
    """

    def __init__(
        self,
        operator: Operator,
        rig: RigDescription,
        folder: Path,
        processes: NodeProcesses | None = None,
    ) -> None:
        self.operator, self.processes = operator, processes
        self._rig = rig
        self._folder = folder
        self.delay_s = 0.0

    def bag(self, name: str) -> Path:
        """Return the place of a bag."""
        return self._folder / name

    def measured(self, wanted: Measurement) -> IoData:
        """Return the record of a measurement, which is made unless its bag is there.

        Raises
        ------
        LaunchError
            When a node does not do its part, or the record is incomplete.
        """
        bag = self.bag(wanted.name)
        if bag.exists():
            terminal.CONSOLE.print(f"  {wanted.name} was measured before")
            return self.record(wanted.name)
        # One that was killed left it: its part is of no use here.
        shutil.rmtree(workplace(bag), ignore_errors=True)
        self.operator.set_parameters(wanted.commander, wanted.parameters)
        samples = round(wanted.length_s * self._rig.rate_hz)
        with new_record(bag) as record:
            recorded = record_run(
                self.operator, wanted.commander, record, samples, text=wanted.name, bag=bag
            )
        self.delay_s = 0.0 if recorded.lockstep else recorded.run.reply_s
        return recorded.reading.data

    def record(self, name: str) -> IoData:
        """Return the record in a bag."""
        return read_bag(self.bag(name))

    def forget(self, name: str) -> None:
        """Remove a bag, which is measured again."""
        shutil.rmtree(self.bag(name), ignore_errors=True)

    def set_references(self, values: Mapping[str, float]) -> None:
        """Give the controller set-points by output, in force from its next run on.

        Raises
        ------
        LaunchError
            When one is refused.
        """
        for output, value in values.items():
            self.operator.set_reference(value, output)


@contextmanager
def live_arm(
    rig: RigDescription,
    given: Mapping[str, Any],
    folder: Path,
    *,
    pace: Pace,
    namespace: str,
    seed: int = 0,
    files: tuple[Path, ...] = (),
    with_controller: bool = True,
    page: Mapping[str, Any] | None = None,
) -> Iterator[LiveArm]:
    """Start the nodes that excite an arm and record it, and stop them with the drives at rest.

    Parameters
    ----------
    rig : RigDescription
        The arm.
    given : mapping of str to value
        Parameters of the nodes that tell the arm.
    folder : Path
        Folder of the bags and of the nodes' log.
    pace : Pace
        Wall clock, fast or hard real time.
    namespace : str
        Namespace of the nodes.
    seed : int
        Seed of the noise of a simulated arm; 0: that of its description.
    files : tuple of Path
        As for `running_graph`.
    with_controller : bool
        Whether a law is to move the joints, which not every rig has.
    page : mapping of str to value, optional
        Parameters of the page, which is served then.
    """
    pace.prepare()
    parameters: dict[str, dict[str, Any]] = {
        "daq": {"seed": seed, **pace.parameters(), **given},
        "experiment": dict(given),
        "controller": dict(given),
    }
    if not is_thesis_arm(rig):
        parameters["controller"]["law"] = "pd"
        parameters["recorder"] = {"topics": recorded_topics(is_thesis=False)}
    nodes = [each for each in _NODES if with_controller or each != "controller"]
    if page is not None:
        nodes.append("live")
        parameters["live"] = {**page, **given}
    with running_graph(
        parameters, folder / "nodes.log", nodes=nodes, files=files, namespace=namespace
    ) as (operator, processes):
        yield LiveArm(operator, rig, folder, processes)


def answers_to_pulses(
    arm: Arm, rig: RigDescription, begin: Callable[[str], None] = terminal.step
) -> tuple[PulseAnswer, ...]:
    """Pulse each joint, and print and return how it answers; `begin` prints what comes.

    Raises
    ------
    ArmFaultError
        For wrong wiring, a dead sensor, a stuck joint or a loose gear.
    """
    programme, found = Programme(rig), []
    for number, joint in enumerate(rig.joints):
        begin(f"Pulses on {joint.input}, growing until {joint.angle} moves, for direction and gain")
        answer = judge_pulses(arm.measured(programme.pulses(number)), rig, joint)
        units = rig.output(joint.angle).unit, rig.input(joint.input).unit
        terminal.CONSOLE.print(
            f"  {joint.angle} moves by {answer.way:.3g} {units[0]} at {answer.height:.3g} "
            f"{units[1]}: {answer.gain:.3g} {units[0]}/s² for 1 {units[1]} at least"
        )
        found.append(answer)
    require_all_answer(found, rig)
    return tuple(found)
