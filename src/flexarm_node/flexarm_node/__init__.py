"""What every node of flexarm shares: QoS, bounded parameters, signals, the fast path."""
