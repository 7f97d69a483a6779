"""Nodes of the rig: DAQ, experiment, recorder and player."""
