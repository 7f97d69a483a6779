"""Subspace identification, modal reduction, model updating and validation."""
