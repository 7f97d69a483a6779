"""Rig driven by a function of time and outputs, where no control law is wanted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.law_protocol import Effort
from flexarm_control.simulation import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from flexarm_control.simulation import LoopRun
    from flexarm_daq import SimulatedRig

    Drive = Callable[[float, NDArray[np.float64]], float]


class _Driven:
    """A function as a law: its reference is the time."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive

    def step(self, volts: Sequence[float], time_s: float) -> Effort:
        return Effort(self._drive(time_s, np.array(volts)), 0.0)

    def reset(self) -> None:
        pass


def driven(rig: SimulatedRig, drive: Drive, samples: int, rate_hz: float = 300.0) -> LoopRun:
    """Run a rig under a function, held within the range of the drive.

    Parameters
    ----------
    rig : SimulatedRig
        The rig.
    drive : callable
        Command, V, from the time since the start, s, and the four outputs, V.
    samples : int
        Length of the run.
    rate_hz : float
        Sampling rate of the rig, Hz.
    """
    law = _Driven(lambda time_s, volts: min(max(drive(time_s, volts), -10.0), 10.0))
    return simulate(rig, law, np.arange(samples) / rate_hz, true_outputs=rig.outputs_v)
