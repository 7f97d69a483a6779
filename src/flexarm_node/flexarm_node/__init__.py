"""Shared parts of the nodes of flexarm: QoS, bounded parameters, signals, the fast path."""
