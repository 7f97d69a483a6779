"""Gram matrix of the block Hankel data, from lag sums.

The Hankel matrices of (2-19) enter the algorithms only through their products. With
``z = [y u]`` the block (i, j) of the product is a sum over the record, and

    G(i + 1, j + 1) = G(i, j) - z_i z_j' + z_{i+d} z_{j+d}'

so the first block row, the lag sums, gives all others. Nothing of the Hankel matrices' size is ever
formed, and the products of several records simply add up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.iodata import IoData

_BLOCK = 8
_CHUNK = 512 * _BLOCK


@dataclass(frozen=True)
class BlockGram:
    """Product of the block Hankel matrix of ``z = [y u]`` with its transpose.

    Attributes
    ----------
    matrix : ndarray, (block_rows * (outputs + inputs),) * 2
        The product; block row i holds the outputs and then the inputs of time shift i.
    block_rows : int
        Number of time shifts, q of (2-18).
    outputs, inputs : int
        Channel counts.
    columns : int
        Columns of the Hankel matrix, d of (2-19), summed over the records.
    """

    matrix: FloatArray
    block_rows: int
    outputs: int
    inputs: int
    columns: int

    def output_rows(self, first: int, last: int) -> list[int]:
        """Return the rows of the outputs in block rows `first` to `last`, exclusive."""
        return self._rows(first, last, 0, self.outputs)

    def input_rows(self, first: int, last: int) -> list[int]:
        """Return the rows of the inputs in block rows `first` to `last`, exclusive."""
        return self._rows(first, last, self.outputs, self.outputs + self.inputs)

    def _rows(self, first: int, last: int, low: int, high: int) -> list[int]:
        channels = self.outputs + self.inputs
        return [i * channels + c for i in range(first, last) for c in range(low, high)]


def block_gram(records: Sequence[IoData], block_rows: int) -> BlockGram:
    """Return the block Gram of one or several records.

    Parameters
    ----------
    records : sequence of IoData
        Records of the same rig.
    block_rows : int
        Number of time shifts, q of (2-18).

    Returns
    -------
    BlockGram
        Sum of the records' Gram matrices.

    Raises
    ------
    DataError
        If a record has fewer samples than `block_rows`.
    """
    first = records[0]
    channels = first.y.shape[1] + first.u.shape[1]
    total = np.zeros((block_rows * channels, block_rows * channels))
    columns = 0
    for record in records:
        if len(record) < block_rows:
            raise DataError(
                f"{record.label}: {len(record)} samples are fewer than the {block_rows} block rows"
            )
        z = np.hstack([record.y, record.u])
        total += _record_gram(z, block_rows)
        columns += len(z) - block_rows + 1
    return BlockGram(total, block_rows, first.y.shape[1], first.u.shape[1], columns)


def lag_sums(z: FloatArray, lags: int) -> FloatArray:
    """Return the sums of ``z_k z_{k+j}'`` over ``k = 0 .. K - lags``, for ``j = 0 .. lags - 1``.

    Blocks of a few samples are multiplied at once, so that the work is done by matrix products.

    Parameters
    ----------
    z : ndarray, (samples, channels)
        Signals.
    lags : int
        Number of lags.

    Returns
    -------
    ndarray, (lags, channels, channels)
        The sums.
    """
    samples, channels = z.shape
    columns = samples - lags + 1
    shifts = (lags + _BLOCK - 2) // _BLOCK + 1
    whole = max((samples // _BLOCK - shifts + 1) * _BLOCK, 0)
    whole = min(whole, columns // _BLOCK * _BLOCK)
    blocks = z[: samples // _BLOCK * _BLOCK].reshape(-1, _BLOCK * channels)
    products = np.zeros((shifts, _BLOCK * channels, _BLOCK * channels))
    for start in range(0, whole // _BLOCK, _CHUNK // _BLOCK):
        stop = min(start + _CHUNK // _BLOCK, whole // _BLOCK)
        for shift in range(shifts):
            products[shift] += blocks[start:stop].T @ blocks[start + shift : stop + shift]
    folded = products.reshape(shifts, _BLOCK, channels, _BLOCK, channels)
    # Sample i of a block meets sample t of the row of shifted blocks at lag t - i.
    rows = folded.transpose(1, 0, 3, 2, 4).reshape(_BLOCK, -1, channels, channels)
    sums = sum((rows[i, i : i + lags] for i in range(_BLOCK)), np.zeros((lags, channels, channels)))
    tail = z[whole:columns]
    for lag in range(lags):
        sums[lag] += tail.T @ z[whole + lag : columns + lag]
    return np.asarray(sums)


def _record_gram(z: FloatArray, block_rows: int) -> FloatArray:
    channels = z.shape[1]
    columns = len(z) - block_rows + 1
    size = block_rows * channels
    gram = np.empty((size, size))
    row = lag_sums(z, block_rows).transpose(1, 0, 2).reshape(channels, size)
    leaving, entering = z[: block_rows - 1], z[columns : columns + block_rows - 1]
    for i in range(block_rows):
        here = slice(i * channels, (i + 1) * channels)
        gram[here, i * channels :] = row
        gram[i * channels :, here] = row.T
        if i < block_rows - 1:
            row = (
                row[:, :-channels]
                - np.outer(leaving[i], leaving[i:].ravel())
                + np.outer(entering[i], entering[i:].ravel())
            )
    return gram
