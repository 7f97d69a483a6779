"""Folders of the checkout."""

from __future__ import annotations

from pathlib import Path

PROJECT = Path(__file__).parents[2]
BAGS = PROJECT / "bags"
SHARED = PROJECT.parent / "shared"
"""Measurements beside the checkout; tests that use them are skipped where they are missing."""
