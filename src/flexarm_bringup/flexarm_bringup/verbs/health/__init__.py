"""Verbs that examine the environment and the hardware."""
