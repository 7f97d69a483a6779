"""Pace of a run: that of the wall clock, as fast as it goes, or hard real time."""

from __future__ import annotations

import os
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexarm_bringup.graph.figures import Run
    from flexarm_bringup.graph.operator import Operator

_OFF_RATE = (
    "the record's times are wrong, and frequencies that are identified from it "
    "(docs/howto/own_rig.md says who paces a rig)"
)


class Pace(Enum):
    """Pace that a user can choose; the first two differ in nothing else."""

    WALL_CLOCK = "wall clock"
    """The simulated rig in virtual time that waits for the wall clock; a board in real time."""
    FAST = "fast"
    """Virtual time, as fast as the machine can."""
    REAL = "real"
    """Hard real time: a late sample is a lost one."""

    def prepare(self) -> None:
        """Set up this process for the nodes that it will start."""
        from flexarm_node.process import PRIORITY  # noqa: PLC0415 - it loads rclpy

        if self is Pace.FAST:
            # Virtual time that never rests would starve the recorder at real-time priority.
            os.environ[PRIORITY] = "0"

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the DAQ node; none where its own defaults and files say it."""
        if self is Pace.FAST:
            return {"time": "virtual", "real_time_factor": 0.0}
        return {"time": "real"} if self is Pace.REAL else {}


def in_lockstep(operator: Operator) -> bool:
    """Return whether the DAQ node of a graph samples in virtual time."""
    from flexarm_daq.nodes.rig_choice import is_virtual  # noqa: PLC0415 - it loads rclpy

    return is_virtual(operator.values("daq", ("rig", "time")))


def pace_text(run: Run) -> str:
    """Return the pace of a run, its missed periods and a wrong rate as text."""
    missed = f", {run.missed} periods without a sample" if run.missed else ""
    text = f"ran at {run.real_time_factor:.2f} of real time{missed}"
    if not run.off_rate:
        return text
    return f"{text}\n  warning: sampled at {run.off_rate}: {_OFF_RATE}"
