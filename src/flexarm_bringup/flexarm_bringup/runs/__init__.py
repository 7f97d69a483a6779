"""Runs on the graph and their records."""
