"""Registry of the subspace estimators, one row each, and the choice from it.

A new estimator is a module with a function that returns a `Subspace`, and a row here. The check of
requests, `identify`, the command's help, the reports and the documentation read the rows.

With `method="auto"` the first of these conditions that holds decides:

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

from flexarm_core.errors import IdentificationError
from flexarm_ident.models.state_space import WAYS
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.subspace.feedback import reaches_inputs
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.orse import innovation_scaled, past_instruments, plain
from flexarm_ident.subspace.pbsid import predictor_space

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_ident.models.state_space import Way
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.gram import BlockGram
    from flexarm_ident.subspace.orse import RangeSpace
    from flexarm_ident.subspace.subspace_protocol import Subspace

AUTO = "auto"
"""Name of the choice from the data, as `chosen` and `estimation.weighing` make it."""
_DEVIATIONS = 6.0
# The scaling is estimated as well, and a spread as small has no visible effect on a model.
_TOLERATED = 0.01
# Noise power in units of the innovation's; less is rounding.
_SMALLEST_NOISE = 1e-2


class Data(NamedTuple):
    """Data for an estimator: products of `Method.shifts` block rows, and records or their heads.

    An `order` is one that alone is asked for.
    """

    gram: BlockGram
    records: Sequence[IoData]
    feedthrough: bool
    order: int | None = None


@dataclass(frozen=True)
class Method:
    """Estimator with its name, titles and needs.

    Attributes
    ----------
    name : str
        Value of `method` in requests.
    build : callable
        Function from `Data` to a `Subspace`.
    looks_back : bool
        Whether it takes as many block rows of the past as of the future.
    title : str
        Name in reports.
    help : str
        Field of use, in a few words.
    noise_weighted : bool
        Whether the fit of B weights the outputs by their noise.
    weighed : bool
        Whether 'auto' weighs it.
    ways : tuple of Way
        Ways to move unstable eigenvalues, the best of which is taken.
    consistent_under_feedback : bool
        Whether it is consistent where inputs were computed from the outputs.
    at_rest : bool
        Whether records start from rest and B is fitted without weights, as (2-14) and (2-17) are
        printed; otherwise initial states are fitted.
    """

    name: str
    build: Callable[[Data], Subspace]
    looks_back: bool
    title: str
    help: str
    noise_weighted: bool = True
    weighed: bool = True
    ways: tuple[Way, ...] = WAYS
    consistent_under_feedback: bool = False
    at_rest: bool = False

    def shifts(self, block_rows: int) -> int:
        """Return the block rows of the Gram for `block_rows` block rows of the future."""
        return 2 * block_rows if self.looks_back else block_rows


_ROWS = (
    Method(
        name="orse",
        build=lambda data: innovation_scaled(data.gram),
        looks_back=False,
        title="ORSE, outputs scaled by their innovation",
        help="open loop, white noise",
    ),
    Method(
        name="orse_iv",
        build=lambda data: past_instruments(data.gram),
        looks_back=True,
        title="ORSE with past data as instruments",
        help="coloured noise",
    ),
    Method(
        name="pbsid",
        build=lambda data: predictor_space(
            data.gram, feedthrough=data.feedthrough, order=data.order
        ),
        looks_back=True,
        title="PBSID-opt",
        help="closed loop, friction",
        consistent_under_feedback=True,
    ),
    Method(
        name="orse_thesis",
        build=lambda data: plain(data.gram, output_scale(data.records)),
        looks_back=False,
        title="ORSE, outputs scaled by their maxima",
        help="the thesis's own way, to reproduce it",
        noise_weighted=False,
        weighed=False,
        ways=("clamp",),
        at_rest=True,
    ),
)
METHODS = {row.name: row for row in _ROWS}
"""The estimators by name."""


def check_method(name: str) -> None:
    """Raise an IdentificationError for a method that is neither 'auto' nor in `METHODS`."""
    if name not in (AUTO, *METHODS):
        choices = ", ".join((AUTO, *METHODS))
        raise IdentificationError(f"method must be one of {choices}: {name!r}")


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
