"""Standard deviations of modes and of the frequency response, by a jackknife over segments.

The Gram matrix of a record is the sum of those of its segments. One segment is left out by a
subtraction, so that many estimates, each from most of the data, cost hardly more than one. Their
scatter is that of the estimate itself for noise of any kind, as long as a segment is longer than
the memory of the noise.
Kuensch, "The jackknife and the bootstrap for general stationary observations", Annals of
Statistics 17 (1989).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.modes import (
    ModeUncertainty,
    frequency_and_damping,
    modal_form,
    nearest,
)
from flexarm_ident.models.state_space import WAYS, state_space
from flexarm_ident.records.iodata import as_records
from flexarm_ident.subspace.gram import SEGMENTS, cut, rows, segment_grams

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control
    from numpy.typing import ArrayLike

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram, Segment
    from flexarm_ident.subspace.subspace_protocol import StateMatrices

Estimate = TypeVar("Estimate")


@dataclass(frozen=True, eq=False)
class Jackknife(Generic[Estimate]):
    """Estimates, such as A and C, from all data and without one segment each.

    `remainders` are the data of each of the latter, without the rows `left_out` of one record.
    `gram` holds the products of all data.
    """

    gram: BlockGram
    estimate: Callable[[BlockGram], Estimate]
    replicates: tuple[Estimate, ...]
    remainders: tuple[tuple[IoData, ...], ...]
    left_out: tuple[Rows, ...]

    @cached_property
    def whole(self) -> Estimate:
        """Estimate from all data."""
        return self.estimate(self.gram)


class Rows(NamedTuple):
    """Rows of one of several records."""

    record: int
    rows: slice


@dataclass(frozen=True, eq=False)
class ResponseUncertainty:
    """Frequency response with its standard deviation.

    Attributes
    ----------
    frequencies_hz : ndarray, (frequencies,)
        Frequencies.
    response : ndarray, (frequencies, outputs, inputs)
        Complex gains of the estimate from all data.
    deviation : ndarray, (frequencies, outputs, inputs)
        Standard deviation of the complex gain: the root of its mean squared distance.
    """

    frequencies_hz: FloatArray
    response: ComplexArray
    deviation: FloatArray


def jackknife(
    records: IoData | Sequence[IoData],
    block_rows: int,
    estimate: Callable[[BlockGram], Estimate],
    *,
    segments: int = SEGMENTS,
) -> Jackknife[Estimate]:
    """Estimate from all data, and from all but one segment for each segment.

    Parameters
    ----------
    records : IoData or sequence of IoData
        Records of one rig.
    block_rows : int
        Time shifts of the Gram matrix that the estimate needs.
    estimate : callable
        From a Gram matrix to A and C of one method and order, or to all that the method gives.
    segments : int
        Segments of all records together; fewer when they would be shorter than `block_rows`.

    Raises
    ------
    DataError
        If the records are too short for four segments.
    """
    checked = as_records(records)
    parts = cut(checked, block_rows, segments)
    grams = segment_grams(checked, block_rows, parts)
    whole = replace(
        grams[0],
        matrix=np.sum([gram.matrix for gram in grams], axis=0),
        columns=sum(gram.columns for gram in grams),
    )
    replicates = tuple(
        estimate(
            replace(whole, matrix=whole.matrix - gram.matrix, columns=whole.columns - gram.columns)
        )
        for gram in grams
    )
    remainders, left_out = zip(*_halves(checked, block_rows, parts), strict=True)
    return Jackknife(whole, estimate, replicates, remainders, left_out)


def blocks_left_out(
    records: Sequence[IoData], block_rows: int, segments: int
) -> list[tuple[tuple[IoData, ...], Rows]]:
    """Return for each segment of the records what remains without it, and its rows.

    Raises
    ------
    DataError
        If the records are too short for four segments.
    """
    return _halves(records, block_rows, cut(records, block_rows, segments))


def mode_uncertainty(
    found: Jackknife[StateMatrices], model: control.StateSpace
) -> tuple[ModeUncertainty, ...]:
    """Return modes with their standard deviations, in the order of `ranked_modes`.

    The model is the one from all data, or a part of its modes.
    """
    form = modal_form(model)
    own = form.eigenvalues[[group[0] for group in form.groups]]
    figures = [_figures(_matched(own, each.A), form.dt_s) for each in found.replicates]
    pairs = zip(_figures(own, form.dt_s), deviation(np.array(figures)).tolist(), strict=True)
    return tuple(ModeUncertainty(*figure, *std) for figure, std in pairs)


def frequency_response_uncertainty(
    found: Jackknife[StateMatrices],
    records: IoData | Sequence[IoData],
    frequencies_hz: ArrayLike,
    *,
    feedthrough: bool = False,
) -> ResponseUncertainty:
    """Return the frequency response, (frequencies, outputs, inputs), with its standard deviation.

    For each replicate of a jackknife of the records, B, the initial states and, with feedthrough, D
    are fitted to the remaining data.
    """
    grid = np.asarray(frequencies_hz, dtype=np.float64)

    def response(matrices: StateMatrices, data: Sequence[IoData]) -> ComplexArray:
        A, fit, *_ = fit_stable(
            *(matrices.A, matrices.C, data, WAYS), feedthrough=feedthrough, noise_weighted=True
        )
        model = state_space(A, fit.B, matrices.C, fit.D, data[0].dt_s)
        return frequency_response(model, grid)

    pairs = zip(found.replicates, found.remainders, strict=True)
    replicates = np.array([response(*pair) for pair in pairs])
    return ResponseUncertainty(
        grid, response(found.whole, as_records(records)), deviation(replicates)
    )


def deviation(replicates: FloatArray | ComplexArray) -> FloatArray:
    """Return the jackknife's standard deviation over the first axis."""
    count = len(replicates)
    scatter = np.abs(replicates - replicates.mean(axis=0)) ** 2
    return np.asarray(np.sqrt((count - 1) / count * scatter.sum(axis=0)))


def _halves(
    records: Sequence[IoData], block_rows: int, parts: Sequence[Segment]
) -> list[tuple[tuple[IoData, ...], Rows]]:
    return [(_without(records, block_rows, each), _left_out(each, block_rows)) for each in parts]


def _without(records: Sequence[IoData], block_rows: int, segment: Segment) -> tuple[IoData, ...]:
    """Return the records without a segment, which leaves one or two pieces of its record."""
    record = records[segment.record]
    pieces = [
        rows(record, low, high)
        for low, high in ((0, segment.first), (segment.last, len(record)))
        if high - low >= block_rows
    ]
    return (*records[: segment.record], *pieces, *records[segment.record + 1 :])


def _left_out(segment: Segment, block_rows: int) -> Rows:
    """Return the samples of a segment that no column before it reaches."""
    first = min(segment.first + block_rows - 1, segment.last - 1) if segment.first else 0
    return Rows(segment.record, slice(first, segment.last))


def _matched(own: ComplexArray, A: FloatArray) -> ComplexArray:
    """Return the eigenvalue of A next to each mode, each used once."""
    eigenvalues = np.linalg.eigvals(A).astype(complex)
    upper = eigenvalues[eigenvalues.imag >= 0.0]
    if len(upper) < len(own):
        # Some pairs of the model have one real eigenvalue each, or none, in the replicate.
        upper = eigenvalues
    return np.asarray(upper[nearest(own, upper)])


def _figures(eigenvalues: ComplexArray, dt_s: float) -> list[tuple[float, float]]:
    return [frequency_and_damping(complex(eigenvalue), dt_s) for eigenvalue in eigenvalues]
