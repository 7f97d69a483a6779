"""Benchmarks of the control laws on the simulated rig."""
