"""Flexible arm with dry friction: equations of motion and their fit to records."""
