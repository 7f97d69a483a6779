"""The rig: beam and motor simulation, DAQ driver node, recording and replay."""

from flexarm_daq.parameters import RigParameters
from flexarm_daq.simulated_rig import SimulatedRig

__all__ = ["RigParameters", "SimulatedRig"]
