"""Source of the samples of an estimator: a record in memory, or a bag read piece by piece."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import DataWarning, IoData


class Samples(Protocol):
    """Inputs and outputs that can be gone through any number of times."""

    def __len__(self) -> int:
        """Return the number of samples."""

    def chunks(self, samples: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Return u and y from the start, `samples` rows each, the last pair with the rest.

        Rows of y that are not to be used, in holes too long to be filled, are NaN.
        """


class Source(Samples, Protocol):
    """Samples of one record with what belongs to them."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""

    @property
    def dt_s(self) -> float:
        """Sampling period."""

    @property
    def label(self) -> str:
        """Name of the record in messages."""

    @property
    def closed_loop(self) -> bool | None:
        """Whether the inputs were computed from the outputs; None when it is not known."""

    @property
    def notices(self) -> tuple[DataWarning, ...]:
        """What is known to be wrong with how the samples were taken."""

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples as a record in memory (all if there are fewer)."""


def even_chunks(
    pieces: Iterable[tuple[FloatArray, FloatArray]], samples: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Cut and join pieces of u and y of any length into chunks as `Source.chunks` gives them.

    Parameters
    ----------
    pieces : iterable of (u, y)
        Rows that follow each other.
    samples : int
        Rows of a chunk.

    Yields
    ------
    tuple of ndarray
        u and y, `samples` rows each; the last pair has the rest.
    """
    waiting: list[tuple[FloatArray, FloatArray]] = []
    count = 0
    for piece in pieces:
        u, y = piece
        while count + len(u) >= samples:
            cut = samples - count
            yield joined([*waiting, (u[:cut], y[:cut])])
            u, y = u[cut:], y[cut:]
            waiting, count = [], 0
        if len(u):
            waiting.append((u, y))
            count += len(u)
    if count:
        yield joined(waiting)


def joined(pieces: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return pieces of u and y, one or more, as one."""
    if len(pieces) == 1:
        return pieces[0]
    return np.concatenate([u for u, _ in pieces]), np.concatenate([y for _, y in pieces])
