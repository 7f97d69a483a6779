"""Verbs of the `flexarm` command: each module is imported when its verb is called."""
