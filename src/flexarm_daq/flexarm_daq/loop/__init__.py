"""The sampling loop: acquisition, commands, limits and safety."""
