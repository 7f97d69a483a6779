"""Replay of recorded controllers."""
