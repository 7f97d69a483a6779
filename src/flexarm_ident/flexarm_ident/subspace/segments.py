"""Segments of records, for the scatter of an estimate."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import DataError
from flexarm_ident.subspace.gram import block_gram

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

# Edges of more, shorter segments would add scatter; fewer would estimate it poorly.
SEGMENTS = 10
_FEWEST_SEGMENTS = 4


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
