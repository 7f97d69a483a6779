"""Texts that are small as they stand and huge when they are spelt out."""

from __future__ import annotations


def doubled(levels: int) -> str:
    """Return a YAML list whose aliases, spelt out, are 2 ** levels values."""
    nested = "".join(f", &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, levels))
    return f"[&a0 [x, x]{nested}]"


def doubled_maps(levels: int) -> str:
    """Return a YAML mapping whose aliases, spelt out, are 2 ** levels values."""
    nested = "".join(f", {k}: &a{k} {{0: *a{k - 1}, 1: *a{k - 1}}}" for k in range(1, levels))
    return f"{{0: &a0 {{0: x, 1: x}}{nested}}}"
