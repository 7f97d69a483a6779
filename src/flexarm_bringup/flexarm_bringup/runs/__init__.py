"""Runs on the graph: demo, experiments, the kept laboratory."""
