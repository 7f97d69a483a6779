"""The node graph as processes, and its operator."""
