"""The rig: beam and motor simulation, DAQ driver node, recording and replay."""

from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_daq.rigs.simulated import SimulatedRig

__all__ = ["RigParameters", "SimulatedRig"]
