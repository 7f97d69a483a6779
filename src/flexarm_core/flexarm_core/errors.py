"""What can go wrong in an identification, as one line each."""

from __future__ import annotations


class IdentificationError(ValueError):
    """The data or the request does not allow an identification."""


class DataError(IdentificationError):
    """An experiment's record is malformed."""
