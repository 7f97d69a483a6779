"""Laboratory on the terminal: one screen of a running arm, and its keys."""
