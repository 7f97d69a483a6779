"""Bytes of a bag: MCAP records, chunks of messages, and their columns."""
