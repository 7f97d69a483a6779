"""Records cut into segments of about the same length, to see how much an estimate scatters."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.errors import DataError
from flexarm_ident.gram import block_gram

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.gram import BlockGram
    from flexarm_ident.iodata import IoData

# More would leave edges of short segments in the scatter, fewer would scatter themselves.
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

    Returns
    -------
    list of Segment
        The segments, in the order of the records.

    Raises
    ------
    DataError
        If the records are too short for four segments.
    """
    columns = [len(record) - block_rows + 1 for record in records]
    length = max(block_rows, -(-sum(columns) // segments))
    parts = []
    for number, count in enumerate(columns):
        edges = np.linspace(0, count, max(1, round(count / length)) + 1).astype(int)
        parts += [Segment(number, int(first), int(last)) for first, last in pairwise(edges)]
    if min(columns) < 1 or len(parts) < _FEWEST_SEGMENTS:
        raise DataError(
            f"{records[0].label}: {sum(len(record) for record in records)} samples are too few for "
            f"{_FEWEST_SEGMENTS} segments of {block_rows} block rows: record longer"
        )
    return parts


def segment_grams(
    records: Sequence[IoData], block_rows: int, parts: Sequence[Segment]
) -> list[BlockGram]:
    """Return the products of each segment; they add up to those of the records.

    Segments overlap in samples, so that no column of the Hankel matrix is lost between them.
    """
    return [
        block_gram([rows(records[part.record], part.first, part.last + block_rows - 1)], block_rows)
        for part in parts
    ]


def rows(record: IoData, first: int, last: int) -> IoData:
    """Return inputs and outputs of the rows `first` to `last`, exclusive."""
    part = slice(first, last)
    return replace(record, u=record.u[part], y=record.y[part], compensation=None, reference=None)
