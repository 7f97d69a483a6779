"""Protocol of an estimator's result: A and C of every order, from one decomposition."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

SMALLEST_INNOVATION = 1e-6
"""Part of an output's RMS below which its innovation is rounding, not noise."""
LARGEST_ORDER = 36
"""The largest of Tables 2-1 to 2-4."""


class StateMatrices(NamedTuple):
    """A and C of one realisation."""

    A: FloatArray
    C: FloatArray


def normalised(C: FloatArray) -> FloatArray:
    """Return C with unit norm, which fixes the free unit of the states."""
    return np.asarray(C / np.linalg.norm(C))


class Subspace(Protocol):
    """Result of an estimator: models of every order, from one decomposition."""

    @property
    def singular_values(self) -> FloatArray:
        """Singular values, descending."""

    @property
    def output_scale(self) -> FloatArray:
        """Factors the outputs were multiplied by."""

    @property
    def block_rows(self) -> int:
        """Block rows that were used."""

    @property
    def largest_order(self) -> int:
        """Largest order that the data determine."""

    def matrices(self, order: int) -> StateMatrices:
        """Return A and C of one order."""
