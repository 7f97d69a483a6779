"""Work in a checkout: checks, documentation, benchmarks."""
