"""Benchmarks of the running graph: rig, loop, recording, faults."""
