"""Bag record that is read piece by piece, for records larger than memory.

Only the instants of its samples stay in memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_core.errors import DataError
from flexarm_ident.records.holes import CONTEXT, filled_pieces, joined
from flexarm_ident.records.iodata import IoData
from flexarm_ident.records.source import even_chunks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning

    Rows = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class Header:
    """Facts of a record beside its rows, as in `IoData`."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt_s: float
    closed_loop: bool | None
    source: str
    notices: tuple[DataWarning, ...]

    @property
    def label(self) -> str:
        """Name of the record in messages."""
        return self.source

    @property
    def facts(self) -> dict[str, Any]:
        """The fields by their names."""
        return {each.name: getattr(self, each.name) for each in fields(Header)}

    def record(self, u: FloatArray, y: FloatArray, **others: Any) -> IoData:  # noqa: ANN401
        """Return inputs and outputs, and other fields of `IoData`, as a record."""
        return IoData(u, y, **{**self.facts, **others})

    def leading(self, pieces: Iterable[Rows], samples: int) -> IoData:
        """Return the first rows of a record in pieces, without compensation."""
        # Rows behind the last one tell how a hole before it is filled.
        taken, left = [], samples + CONTEXT
        for u, y in pieces:
            taken.append((u[:left], y[:left]))
            left -= len(u)
            if left <= 0:
                break
        return self.record(*joined(taken)).head(samples)

    def check(self, pieces: Iterable[Rows]) -> None:
        """Go through a record once, to make sure that it is usable.

        Parameters
        ----------
        pieces : iterable of (u, y)
            All its rows; NaN in y is not measured.

        Raises
        ------
        DataError
            If names do not fit, an input is not finite, an output is infinite or was never
            measured.
        """
        first = 0
        measured = np.zeros(len(self.outputs), dtype=np.bool_)
        for u, y in pieces:
            if (u.shape[1], y.shape[1]) != (len(self.inputs), len(self.outputs)):
                raise DataError(
                    f"{self.source}: {u.shape[1]} inputs and {y.shape[1]} outputs, but "
                    f"{len(self.inputs)} and {len(self.outputs)} names"
                )
            for names, wrong in ((self.inputs, ~np.isfinite(u)), (self.outputs, np.isinf(y))):
                bad = np.argwhere(wrong)
                if len(bad):
                    row, channel = bad[0]
                    raise DataError(
                        f"{self.source}: {names[channel]} is not finite in row {first + row}"
                    )
            measured |= ~np.isnan(y).all(axis=0)
            first += len(u)
        for name, ever in zip(self.outputs, measured, strict=True):
            if not ever:
                raise DataError(f"{self.source}: {name} was never measured: leave it out")


@dataclass(frozen=True, eq=False)
class BagStream(Header):
    """Record of a bag as a `Source`, equal to that of `read_bag` without the compensation."""

    _rows: int = field(repr=False)
    _open: Callable[[], Iterator[Rows]] = field(repr=False)

    def __len__(self) -> int:
        return self._rows

    @property
    def whole_samples(self) -> int:
        """Number of samples: a bag is read from its first one to its last."""
        return self._rows

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples as a record in memory (all if there are fewer)."""
        return replace(self.leading(self._open(), samples), head_of=self._rows)

    def chunks(self, samples: int) -> Iterator[Rows]:
        """Return u and y from the start, `samples` rows each, as `Samples.chunks` says."""
        return even_chunks(filled_pieces(self._open()), samples)
