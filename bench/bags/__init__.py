"""Benchmarks of the bag format: speed of reading, damaged files."""
