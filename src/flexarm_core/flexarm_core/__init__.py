"""Base of every package: channels, errors, parameter tables, array types; the version of all."""

__version__ = "0.1.0"
