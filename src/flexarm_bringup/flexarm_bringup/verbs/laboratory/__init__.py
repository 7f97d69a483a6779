"""Verbs that run or operate the nodes of a laboratory."""
