"""Base of every package: channels, errors, parameter tables, array types."""
