"""Nodes of the rig: DAQ driver, exciter, recorder and player."""
