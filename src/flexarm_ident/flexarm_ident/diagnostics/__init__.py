"""Diagnostics of data and models: quality, stabilisation diagram, uncertainty."""
