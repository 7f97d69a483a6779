"""Learning of a command by repetition, and playing of what was learned."""
