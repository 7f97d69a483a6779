"""The rig: beam and motor simulation, DAQ driver node, recording and replay."""

from typing import TYPE_CHECKING

from flexarm_core.fronts import late

if TYPE_CHECKING:
    from flexarm_daq.rigs.rig_parameters import RigParameters
    from flexarm_daq.rigs.simulated import SimulatedRig
else:
    __getattr__, __dir__ = late(__name__, __file__)

__all__ = ["RigParameters", "SimulatedRig"]
