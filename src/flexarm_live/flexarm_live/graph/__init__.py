"""Bridge to the graph: samples, parameters, services and long work."""
