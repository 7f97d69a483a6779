"""Workflow from records to a validated, reduced model."""
