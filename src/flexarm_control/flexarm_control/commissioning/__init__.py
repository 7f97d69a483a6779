"""Judgement of what an unknown arm answers on the way to its controller."""
