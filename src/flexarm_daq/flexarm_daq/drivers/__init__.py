"""Drivers of rigs as plugins: found by the description of a rig, made from its settings."""
