"""The rig: beam and motor simulation, DAQ driver node, recording and replay."""
