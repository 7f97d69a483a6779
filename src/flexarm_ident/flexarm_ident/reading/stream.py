"""A recorded experiment that is read piece by piece, for records larger than memory.

What is kept in memory of a whole record are the instants of its samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import DataError
from flexarm_ident.records.holes import CONTEXT, filled_pieces
from flexarm_ident.records.source import even_chunks, joined

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.reading.alignment import Header
    from flexarm_ident.records.iodata import DataWarning, IoData

    Rows = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class BagStream:
    """The record of a bag as a `Source`: what `read_bag` gives, without the compensation.

    Attributes
    ----------
    header : Header
        Names, period, kind of loop and notices.
    """

    header: Header
    _rows: int = field(repr=False)
    _open: Callable[[], Iterator[Rows]] = field(repr=False)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.header.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.header.outputs

    @property
    def dt_s(self) -> float:
        """Sampling period."""
        return self.header.dt_s

    @property
    def label(self) -> str:
        """Name of the record in messages."""
        return self.header.source

    @property
    def closed_loop(self) -> bool | None:
        """Whether the inputs were computed from the outputs; None when it is not known."""
        return self.header.closed_loop

    @property
    def notices(self) -> tuple[DataWarning, ...]:
        """What the user should know."""
        return self.header.notices

    def __len__(self) -> int:
        return self._rows

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples as a record in memory (all if there are fewer)."""
        return leading_rows(self.header, self._open(), samples)

    def chunks(self, samples: int) -> Iterator[Rows]:
        """Return u and y from the start, `samples` rows each, as `Samples.chunks` says."""
        return even_chunks(filled_pieces(self._open()), samples)


def leading_rows(header: Header, pieces: Iterator[Rows], samples: int) -> IoData:
    """Return the first rows of a record that passes by in pieces, without compensation.

    Raises
    ------
    DataError
        If names do not fit, or a value is not finite.
    """
    # Rows behind the last one tell how a hole before it is filled.
    taken, left = [], samples + CONTEXT
    for u, y in pieces:
        taken.append((u[:left], y[:left]))
        left -= len(u)
        if left <= 0:
            break
    return header.record(*joined(taken)).head(samples)


def open_stream(header: Header, rows: int, pieces: Callable[[], Iterator[Rows]]) -> BagStream:
    """Go through a record once, to see that it can be used, and return the source.

    Parameters
    ----------
    header
        What is known of the record.
    rows
        Rows that it has.
    pieces
        Starts to go through its rows; NaN in y is not measured.

    Returns
    -------
    BagStream
        The record.

    Raises
    ------
    DataError
        If names do not fit, an input is not finite, an output is infinite or was never measured.
    """
    first = 0
    measured = np.zeros(len(header.outputs), dtype=np.bool_)
    for u, y in pieces():
        if (u.shape[1], y.shape[1]) != (len(header.inputs), len(header.outputs)):
            raise DataError(
                f"{header.source}: {u.shape[1]} inputs and {y.shape[1]} outputs, but "
                f"{len(header.inputs)} and {len(header.outputs)} names"
            )
        for names, wrong in ((header.inputs, ~np.isfinite(u)), (header.outputs, np.isinf(y))):
            bad = np.argwhere(wrong)
            if len(bad):
                row, channel = bad[0]
                raise DataError(
                    f"{header.source}: {names[channel]} is not finite in row {first + row}"
                )
        measured |= ~np.isnan(y).all(axis=0)
        first += len(u)
    for name, ever in zip(header.outputs, measured, strict=True):
        if not ever:
            raise DataError(f"{header.source}: {name} was never measured: leave it out")
    return BagStream(header, rows, pieces)
