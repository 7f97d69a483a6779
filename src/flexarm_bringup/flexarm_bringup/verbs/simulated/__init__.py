"""Verbs that take the simulated arm through its whole course: demo and design."""
