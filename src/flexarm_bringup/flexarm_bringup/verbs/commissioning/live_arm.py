"""Arm of a commissioning on its nodes: each measurement is a bag, and none is made twice."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from typing import TYPE_CHECKING

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import recorded_topics, running_graph
from flexarm_bringup.runs.record_place import new_record, workplace
from flexarm_bringup.runs.recorded_run import record_run
from flexarm_bringup.verbs.laboratory.options import told_rig
from flexarm_core.channels import is_thesis_arm
from flexarm_ident.reading.read import read_bag

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.runs.pace import Pace
    from flexarm_control.commissioning.programme import Measurement
    from flexarm_core.rig_description import RigDescription
    from flexarm_ident.records.iodata import IoData

_NODES = ("recorder", "controller", "experiment", "daq")


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

    Attributes
    ----------
    delay_s : float
        Delay of the loop in the last run, s; 0 in virtual time, which waits for each command.
    """

    def __init__(self, operator: Operator, rig: RigDescription, folder: Path) -> None:
        self._operator = operator
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
        self._operator.set_parameters(wanted.commander, wanted.parameters)
        samples = round(wanted.length_s * self._rig.rate_hz)
        with new_record(bag) as record:
            recorded = record_run(
                self._operator, wanted.commander, record, samples, text=wanted.name, bag=bag
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
            self._operator.set_reference(value, output)


@contextmanager
def live_arm(
    rig: RigDescription, rig_name: str, folder: Path, *, pace: Pace, namespace: str
) -> Iterator[LiveArm]:
    """Start the nodes of an arm, and stop them with the drives at rest.

    Parameters
    ----------
    rig : RigDescription
        The arm.
    rig_name : str
        Its name, or its file.
    folder : Path
        Folder of the bags and of the nodes' log.
    pace : Pace
        Wall clock, fast or hard real time.
    namespace : str
        Namespace of the nodes.
    """
    pace.prepare()
    named = told_rig(rig_name)
    parameters = {
        "daq": named | {"rate_hz": rig.rate_hz} | pace.parameters(),
        "controller": named | {"law": "pd"},
        "experiment": named,
        "recorder": {"topics": recorded_topics(is_thesis=is_thesis_arm(rig))},
    }
    with running_graph(
        parameters,
        folder / "nodes.log",
        nodes=_NODES,
        namespace=namespace,
    ) as (operator, _):
        yield LiveArm(operator, rig, folder)
