"""Benchmarks of flexarm beside its peers; `flexarm bench NAME` runs one."""
