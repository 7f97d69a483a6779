"""Benchmark of the command line."""
