"""Benchmarks of the identification: accuracy, time, damaged records, reduction."""
