"""Health of the environment and of the hardware."""
