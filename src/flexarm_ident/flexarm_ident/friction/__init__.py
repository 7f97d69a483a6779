"""Dry friction: levels, laws, layouts of channels, and whether errors recur with it."""
