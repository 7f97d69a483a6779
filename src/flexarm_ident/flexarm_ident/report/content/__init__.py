"""Building parts of the report's sections."""
