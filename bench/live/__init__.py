"""Looks at the live page."""
