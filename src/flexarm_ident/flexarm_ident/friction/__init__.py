"""Dry friction: levels, and a flexible arm fitted with it."""
