"""Verbs without nodes: bags, models, gains."""
