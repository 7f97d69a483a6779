"""Sources of samples for an estimator: a record in memory, or a bag read piece by piece."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from flexarm_ident.records.holes import joined

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData


class Samples(Protocol):
    """Inputs and outputs that can be read any number of times."""

    def __len__(self) -> int:
        """Return the number of samples."""

    def chunks(self, samples: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Return u and y from the start, `samples` rows each, the last pair with the rest.

        Unusable rows of y, in holes too long to be filled, are NaN.
        """


class Source(Samples, Protocol):
    """Samples of one record with its facts."""

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
    def whole_samples(self) -> int:
        """Number of samples of the record that this is the leading part of, or its own number."""

    @property
    def closed_loop(self) -> bool | None:
        """True when the inputs were computed from the outputs; None when it is not known."""

    @property
    def notices(self) -> tuple[DataWarning, ...]:
        """Known defects of the recording."""

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples as a record in memory (all if there are fewer)."""


def even_chunks(
    pieces: Iterable[tuple[FloatArray, FloatArray]], samples: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Cut and join consecutive pieces of u and y into chunks, as `Samples.chunks` yields them."""
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
