"""Node graph as processes, and its operator."""
