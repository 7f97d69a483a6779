"""Blocked cross-validation: simulation errors on parts of the records that were left out.

The records are cut into blocks. For each of them a model of the same estimator and order is fitted
to the others, and simulates the whole record, as for (2-25). The block's error is what counts: a
fit that follows the noise of its data misses there.

Burman, Chow, Nolan, "A cross-validatory method for dependent data", Biometrika 81 (1994).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.diagnostics.uncertainty import blocks_left_out, jackknife
from flexarm_ident.fitting.output_fit import fit_initial_states
from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.models.state_space import simulate, state_space

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.uncertainty import Jackknife, Rows
    from flexarm_ident.likelihood.maximum_likelihood import LikelihoodFit
    from flexarm_ident.models.state_space import Way
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram
    from flexarm_ident.subspace.subspace_protocol import StateMatrices

Estimate = TypeVar("Estimate")
# Power of a constant output about its mean, in parts of that about zero.
_ROUNDING = 1e-24
_BLOCKS = 5


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Errors on blocks that had no part in the fit.

    Attributes
    ----------
    error : ndarray, (outputs,)
        Simulation error over all blocks together, relative to the deviation about the mean; NaN for
        a constant output.
    """

    error: FloatArray


def without_blocks(
    records: Sequence[IoData], block_rows: int, build: Callable[[BlockGram], Estimate]
) -> Jackknife[Estimate]:
    """Estimate without each of five blocks in turn, for `cross_validate`.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    block_rows : int
        Block rows of the products that the estimate needs.
    build : callable
        Function from products to what an estimator gives.

    Raises
    ------
    DataError
        If the records are too short for blocks.
    """
    return jackknife(records, block_rows, build, segments=_BLOCKS)


def cross_validate(
    records: Sequence[IoData],
    found: Jackknife[Estimate],
    matrices: Callable[[Estimate], StateMatrices],
    ways: Sequence[Way],
    *,
    feedthrough: bool,
    noise_weighted: bool,
) -> CrossValidation:
    """Fit a model without each of five blocks in turn, and simulate the block that was left out.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    found : Jackknife
        Estimates `without_blocks`.
    matrices : callable
        Function from an estimate to A and C, of one order.
    ways : sequence of Way
        Ways to move unstable eigenvalues; none: they stay.
    feedthrough : bool
        Whether D is fitted.
    noise_weighted : bool
        Whether the fit of B weights the outputs by their noise.

    Raises
    ------
    IdentificationError
        If a model without a block is too unstable to simulate.
    """

    def model(estimate: Estimate, others: Sequence[IoData]) -> control.StateSpace:
        raw = matrices(estimate)
        A, fit, *_ = fit_stable(
            *(raw.A, raw.C, others, ways), feedthrough=feedthrough, noise_weighted=noise_weighted
        )
        return state_space(A, fit.B, raw.C, fit.D, others[0].dt_s)

    pairs = zip(found.replicates, found.remainders, strict=True)
    return _judged(records, zip((model(*pair) for pair in pairs), found.left_out, strict=True))


def cross_validate_likelihood(
    records: Sequence[IoData], block_rows: int, fit: LikelihoodFit
) -> CrossValidation:
    """Maximise the likelihood without each of five blocks in turn, and simulate the block.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    block_rows : int
        Fewest rows of a block, or between two blocks.
    fit : LikelihoodFit
        Fit to all data, from which the others start.

    Raises
    ------
    DataError
        If the records are too short for blocks.
    IdentificationError
        If a model without a block cannot be simulated.
    """
    blocks = blocks_left_out(records, block_rows, _BLOCKS)
    return _judged(records, ((fit.refitted(others), rows) for others, rows in blocks))


def _judged(
    records: Sequence[IoData], models: Iterable[tuple[control.StateSpace, Rows]]
) -> CrossValidation:
    """Return the errors of each model over the rows that it has not seen."""
    missed, power = [], []
    for model, block in models:
        record = records[block.record]
        y = simulate(model, record.u, fit_initial_states(model, [record])[0])
        measured = record.y_measured[block.rows]
        missed.append(np.nansum((measured - y[block.rows]) ** 2, axis=0))
        # The offset of an output is there with any model.
        deviation = measured - np.nanmean(record.y_measured, axis=0)
        scatter, level = (np.nansum(each**2, axis=0) for each in (deviation, measured))
        power.append(np.where(scatter > _ROUNDING * level, scatter, 0.0))
    total = np.sum(power, axis=0)
    part = np.divide(
        np.sum(missed, axis=0), total, out=np.full_like(total, np.nan), where=total > 0.0
    )
    error = np.sqrt(part)
    if np.any(np.isinf(error)):
        raise IdentificationError("a model that was fitted without a block cannot be simulated")
    return CrossValidation(error)
