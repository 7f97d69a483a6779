"""State-space models: poles, modes, simulation, and their forms in files."""
