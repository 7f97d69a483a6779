"""Gram matrix of the block Hankel data, from lag sums.

The Hankel matrices of (2-19) enter the algorithms only through their products. With
``z = [y u]`` the block (i, j) of the product is a sum over the record, and

    G(i + 1, j + 1) = G(i, j) - z_i z_j' + z_{i+d} z_{j+d}'

so the first block row, the lag sums, gives all others. No matrix of the Hankel matrices' size is
formed, a record is read in chunks, and the products of several records add up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flexarm_core.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source

_BLOCK = 8
# Matrix products of this length are the fastest: BLAS takes them without packing.
_CHUNK = 512 * _BLOCK
# Power of a shifted signal, in units of that of the whole, below which it is rounding.
_ROUNDING = 1e-13
# Edges of more, shorter segments would add scatter; fewer would estimate it poorly.
SEGMENTS = 10
_FEWEST_SEGMENTS = 4


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

    def leading(self, block_rows: int) -> BlockGram:
        """Return the products of the first `block_rows` block rows.

        The columns stay those of the longer matrix, so the end of each record is left out.
        """
        size = block_rows * (self.outputs + self.inputs)
        leading = self.matrix[:size, :size]
        return BlockGram(leading, block_rows, self.outputs, self.inputs, self.columns)

    def _rows(self, first: int, last: int, low: int, high: int) -> list[int]:
        channels = self.outputs + self.inputs
        return [i * channels + c for i in range(first, last) for c in range(low, high)]


def block_gram(records: Sequence[Source], block_rows: int) -> BlockGram:
    """Return the block Gram of one or several records.

    Parameters
    ----------
    records : sequence of Source
        Records of the same rig, in memory or read in chunks. Holes cut a record into stretches,
        whose products add up too.
    block_rows : int
        Number of time shifts, q of (2-18).

    Raises
    ------
    DataError
        If a record has fewer samples than `block_rows`, or no stretch of any has as many.
    """
    outputs, inputs = len(records[0].outputs), len(records[0].inputs)
    total: FloatArray | float = 0.0
    columns = 0
    for record in records:
        if len(record) < block_rows:
            raise DataError(
                f"{record.label}: {len(record)} samples are fewer than the {block_rows} block rows"
            )
        sums = LagSums(outputs + inputs, block_rows)
        for u, y in record.chunks(_CHUNK):
            for rows in stretches(y):
                if rows.start > 0:
                    sums.end_stretch()
                sums.add(y[rows], u[rows])
            if np.isnan(y[-1]).any():
                sums.end_stretch()
        total = total + sums.gram()
        columns += sums.columns
    if columns == 0:
        raise DataError(
            f"{records[0].label}: no {block_rows} samples, the block rows, follow each other "
            "without a hole: record again or lower block_rows"
        )
    return BlockGram(np.asarray(total), block_rows, outputs, inputs, columns)


def stretches(y: FloatArray) -> Iterator[slice]:
    """Yield the rows of each stretch of outputs, (samples, outputs), without a row of NaN."""
    if len(y) and not np.isnan(y.min()):
        yield slice(0, len(y))
        return
    unusable = np.flatnonzero(np.isnan(y).any(axis=1))
    edges = np.concatenate([[-1], unusable, [len(y)]])
    for before, after in pairwise(edges.tolist()):
        if after - before > 1:
            yield slice(before + 1, after)


class LagSums:
    """Sums of ``z_k z_{k+j}'`` over ``k = 0 .. K - lags`` of a record that is read in chunks.

    A record may have several stretches, each with its own K. Several samples form a block, so that
    the work is done by matrix products.

    Parameters
    ----------
    channels : int
        Signals in z.
    lags : int
        Number of lags, j = 0 .. lags - 1.
    """

    def __init__(self, channels: int, lags: int) -> None:
        self._channels, self._lags = channels, lags
        # A block is multiplied with all that begin up to `lags` samples after its last one.
        self._shifts = (lags + _BLOCK - 2) // _BLOCK + 1
        width, size = _BLOCK * channels, (lags - 1) * channels
        self._products = np.zeros((self._shifts, width, width))
        # Products of the last samples of each stretch, which fill no whole row of blocks.
        self._rest = np.zeros((lags, channels, channels))
        # Entering minus leaving products from one time shift to the next.
        self._change = np.zeros((size, size))
        self._head = self._pending = np.empty((0, channels))
        self._samples = 0
        self.columns = 0
        """Columns of the Hankel matrices of all stretches that have ended, d of (2-19)."""

    def add(self, *signals: FloatArray) -> None:
        """Add the next samples of all signals, each (samples, channels)."""
        waiting, arrived = len(self._pending), len(signals[0])
        z = np.empty((waiting + arrived, self._channels))
        z[:waiting] = self._pending
        columns = (column for each in signals for column in each.T)
        for channel, column in enumerate(columns):
            z[waiting:, channel] = column
        if len(self._head) < self._lags - 1:
            # The pending samples still begin at the start.
            self._head = z[: self._lags - 1].copy()
        blocks = z[: len(z) // _BLOCK * _BLOCK].reshape(-1, _BLOCK * self._channels)
        whole = max(len(blocks) - self._shifts + 1, 0)
        for shift in range(self._shifts if whole else 0):
            self._products[shift] += blocks[:whole].T @ blocks[shift : whole + shift]
        self._pending = z[whole * _BLOCK :].copy()
        self._samples += arrived

    def end_stretch(self) -> None:
        """End the stretch; one shorter than the lags adds nothing."""
        channels, lags = self._channels, self._lags
        if self._samples >= lags:
            if len(self._pending) >= lags:
                windows = sliding_window_view(self._pending, lags, axis=0)
                rest = self._pending[: len(windows)].T @ windows.reshape(len(windows), -1)
                self._rest += rest.reshape(channels, channels, lags).transpose(2, 0, 1)
            leaving = self._head.ravel()
            entering = self._pending[len(self._pending) - lags + 1 :].ravel()
            change = np.stack([entering, leaving]).T @ np.stack([entering, -leaving])
            self._change = self._change + change if self.columns else change
            self.columns += self._samples - lags + 1
        self._head = self._pending = np.empty((0, channels))
        self._samples = 0

    def sums(self) -> FloatArray:
        """End the stretch and return the sums, (lags, channels, channels)."""
        self.end_stretch()
        channels, lags = self._channels, self._lags
        folded = self._products.reshape(self._shifts, _BLOCK, channels, _BLOCK, channels)
        # Sample i of a block meets sample t of the row of shifted blocks at lag t - i.
        rows = folded.transpose(1, 0, 3, 2, 4).reshape(_BLOCK, -1, channels, channels)
        sums = np.sum([rows[i, i : i + lags] for i in range(_BLOCK)], axis=0)
        return np.asarray(sums + self._rest)

    def gram(self) -> FloatArray:
        """End the stretch and return the product of the Hankel matrix with its transpose."""
        channels, lags = self._channels, self._lags
        size = lags * channels
        gram = np.empty((size, size))
        row = self.sums().transpose(1, 0, 2).reshape(channels, size)
        gram[:channels], gram[:, :channels] = row, row.T
        for first in range(channels, size, channels):
            before, here = slice(first - channels, first), slice(first, first + channels)
            row = row[:, :-channels] + self._change[before, first - channels :]
            gram[here, first:] = row
            gram[first:, here] = row.T
        _clear_rounding(gram, channels)
        return gram


def _clear_rounding(gram: FloatArray, channels: int) -> None:
    """Make the rows zero whose power is rounding, which may be negative.

    A signal that rests but for the first few samples has no power in its later shifts.
    """
    power = np.diag(gram).reshape(-1, channels)
    rests = (power <= _ROUNDING * power.max(axis=0)).ravel()
    gram[rests] = 0.0
    gram[:, rests] = 0.0


def equilibrated(gram: BlockGram) -> tuple[FloatArray, FloatArray]:
    """Return the Gram per column of channels with unit RMS, and the channels' RMS.

    The RMS stands in the order outputs, inputs, and is 1 for a channel that is zero throughout.
    """
    channels = gram.outputs + gram.inputs
    power = np.diag(gram.matrix).reshape(gram.block_rows, channels).mean(axis=0)
    rms = np.sqrt(power / gram.columns)
    rms[rms == 0.0] = 1.0
    weight = np.tile(1.0 / rms, gram.block_rows) / np.sqrt(gram.columns)
    scaled = np.outer(weight, weight)
    scaled *= gram.matrix
    return scaled, rms


class Segment(NamedTuple):
    """Columns `first` to `last`, exclusive, of the Hankel matrix of one record."""

    record: int
    first: int
    last: int


def cut(records: Sequence[IoData], block_rows: int, segments: int = SEGMENTS) -> list[Segment]:
    """Cut the columns of the records' Hankel matrices into segments of about the same length.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    block_rows : int
        Block rows of the Hankel matrices.
    segments : int
        Segments of all records together; fewer when they would be shorter than `block_rows`.

    Raises
    ------
    DataError
        If the records are too short for four segments.
    """
    columns = [_columns(record, block_rows) for record in records]
    counts = [len(each) for each in columns]
    length = max(block_rows, -(-sum(counts) // segments))
    parts = []
    for number, (count, usable) in enumerate(zip(counts, columns, strict=True)):
        edges = np.linspace(0, count, max(1, round(count / length)) + 1).astype(int)
        parts += [
            Segment(number, int(usable[first]), int(usable[last - 1]) + 1)
            for first, last in pairwise(edges)
            if last > first
        ]
    if min(counts) < 1 or len(parts) < _FEWEST_SEGMENTS:
        raise DataError(
            f"{records[0].label}: {sum(len(record) for record in records)} samples are too few for "
            f"{_FEWEST_SEGMENTS} segments of {block_rows} block rows: record longer"
        )
    return parts


def segment_grams(
    records: Sequence[IoData], block_rows: int, parts: Sequence[Segment]
) -> list[BlockGram]:
    """Return the products of each segment, whose sum is that of the records.

    Segments overlap in samples, so that no column of the Hankel matrix is lost between them.
    """
    return [
        block_gram([rows(records[part.record], part.first, part.last + block_rows - 1)], block_rows)
        for part in parts
    ]


def _columns(record: IoData, block_rows: int) -> NDArray[np.intp]:
    """Return the columns of the Hankel matrix without a hole."""
    if len(record) < block_rows:
        return np.empty(0, dtype=np.intp)
    holes = np.concatenate([[0], np.cumsum(~record.usable)])
    return np.flatnonzero(holes[block_rows:] == holes[: len(record) - block_rows + 1])


def rows(record: IoData, first: int, last: int) -> IoData:
    """Return inputs and outputs of the rows `first` to `last`, exclusive."""
    part = slice(first, last)
    return replace(
        record,
        u=record.u[part],
        y=record.y_usable[part],
        compensation=None,
        reference=None,
        missing=None,
        input_held=None,
    )
