"""Reference shapers in front of a law."""
