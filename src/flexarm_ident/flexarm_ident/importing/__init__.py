"""Import of measurements from other files."""
