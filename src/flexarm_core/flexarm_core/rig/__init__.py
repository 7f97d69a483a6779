"""Rig description: one YAML file that says what an arm is."""
