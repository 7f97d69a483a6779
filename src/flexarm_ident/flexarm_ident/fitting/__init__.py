"""Least squares: inputs and initial states, refinement by simulation error, validation."""
