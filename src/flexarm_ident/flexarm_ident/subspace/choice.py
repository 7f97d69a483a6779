"""Choice of an estimator by name or from the data (`method="auto"`).

The first of these conditions that holds decides:

1. The record states that its inputs were computed from its outputs (`IoData.closed_loop`):
   PBSID-opt.
2. Later inputs are correlated with the innovation (`feedback.reaches_inputs`): PBSID-opt.
3. The output noise is coloured (`whiteness_test`): ORSE with past instruments.

Otherwise ORSE without instruments is taken, the cheapest and as accurate for white noise. Both ORSE
condition the outputs on later inputs. PBSID-opt regresses on the past only, so that neither
feedback nor friction biases the model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.subspace.feedback import reaches_inputs
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.methods import METHODS, Data
from flexarm_ident.subspace.orse import innovation_scaled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.gram import BlockGram
    from flexarm_ident.subspace.orse import RangeSpace
    from flexarm_ident.subspace.subspace_protocol import Subspace

_DEVIATIONS = 6.0
# The scaling is estimated as well, and a spread as small has no visible effect on a model.
_TOLERATED = 0.01
# Noise power in units of the innovation's; less is rounding.
_SMALLEST_NOISE = 1e-2


class Selection(NamedTuple):
    """Estimator in `METHODS`, its result, and the products that both follow from.

    `reason` is the choice of 'auto' and its reason, in one sentence; empty when the method was
    given.
    """

    method: str
    reason: str
    gram: BlockGram
    space: Subspace


def estimate(
    records: Sequence[Source],
    excerpts: Sequence[IoData],
    method: str,
    block_rows: int,
    *,
    feedthrough: bool,
) -> Selection:
    """Return the result of one estimator in `METHODS`, by `block_rows` block rows q of (2-18).

    The excerpts are the records themselves, or leading parts that fit into memory.
    """
    gram = block_gram(records, METHODS[method].shifts(block_rows))
    return estimate_from(gram, excerpts, method, feedthrough=feedthrough)


def estimate_from(
    gram: BlockGram, excerpts: Sequence[IoData], method: str, *, feedthrough: bool
) -> Selection:
    """Return the result of one estimator, from products of as many block rows as it needs."""
    space = METHODS[method].build(Data(gram, excerpts, feedthrough))
    return Selection(method, "", gram, space)


def select_method(
    records: Sequence[Source],
    block_rows: int,
    *,
    closed_loop: bool,
    order: int | None = None,
    feedthrough: bool = False,
) -> Selection:
    """Return the estimator that the data call for, with its result.

    `closed_loop` states that a record is known to be made in closed loop. An unknown order is taken
    for half of `block_rows`, q of (2-18).
    """

    def chosen(method: str, because: str) -> Selection:
        found = estimate(records, (), method, block_rows, feedthrough=feedthrough)
        return found._replace(reason=f"{method} was chosen: {because}")

    if closed_loop:
        return chosen("pbsid", "closed loop, as declared")
    gram = block_gram(records, block_rows)
    if reaches_inputs(gram):
        return chosen(
            "pbsid",
            "later inputs are correlated with the outputs' noise, by feedback or by friction",
        )
    space = innovation_scaled(gram)
    noise = whiteness_test(space, gram.columns, order or block_rows // 2)
    figures = f"spread {noise.spread:.3g} of its power over directions, limit {noise.limit:.3g}"
    if not noise.white:
        return chosen("orse_iv", f"the outputs' noise is coloured: {figures}")
    reason = (
        "orse was chosen: later inputs are not correlated with the outputs' noise, which passes "
        f"for white: {figures}"
    )
    return Selection("orse", reason, gram, space)


@dataclass(frozen=True)
class WhitenessTest:
    """Outcome of the test.

    Attributes
    ----------
    spread : float
        Variance of the noise eigenvalues, in units of their squared mean; 0 without noise.
    expected : float
        Mean spread of white noise.
    limit : float
        Spread that white noise exceeds by chance only, with six standard deviations.
    white : bool
        Whether the noise passes for white; true when there is none.
    """

    spread: float
    expected: float
    limit: float
    white: bool


def whiteness_test(space: RangeSpace, columns: int, order: int) -> WhitenessTest:
    """Test the noise of outputs scaled by their innovation, given ORSE's range space of them.

    ORSE's eigenvectors beyond the model's order span directions that contain noise only. If the
    noise is white and the outputs are scaled by it, all their eigenvalues are equal; colour spreads
    them. The spread is that of the test of sphericity: John, "Some optimal multivariate tests",
    Biometrika 58 (1971); Ledoit and Wolf, Annals of Statistics 30 (2002).

    Rows of a Hankel matrix repeat each other. The spread of N eigenvalues is then a weighted sum of
    the squared correlations at all lags below q and of all pairs of outputs, each with variance
    1 / d. For white noise its mean is N / d, and its standard deviation sqrt(8 q / 3) / d.

    `columns` is d of (2-19). The eigenvalues beyond the model's order are taken for noise, and half
    of them in any case.
    """
    values = space.singular_values
    size = len(values)
    noise = values[min(order, size // 2) :]
    expected = size / columns
    limit = expected + _DEVIATIONS * np.sqrt(8.0 * space.block_rows / 3.0) / columns + _TOLERATED
    mean = float(noise.mean())
    if mean < _SMALLEST_NOISE:
        return WhitenessTest(0.0, expected, float(limit), white=True)
    spread = float(noise.var()) / mean**2
    return WhitenessTest(spread, expected, float(limit), white=spread <= limit)
