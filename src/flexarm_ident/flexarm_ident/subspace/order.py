"""Choice of the model order: singular values (2-22), stable orders, one-step errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import DataError, IdentificationError
from flexarm_ident.models.state_space import is_stable
from flexarm_ident.subspace.gram import cut, segment_grams
from flexarm_ident.subspace.pbsid import past_length, predictor_space
from flexarm_ident.subspace.subspace_protocol import LARGEST_ORDER

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram
    from flexarm_ident.subspace.pbsid import PredictorSpace
    from flexarm_ident.subspace.subspace_protocol import Subspace

SMALLEST_ORDER = 7
"""The smallest of Tables 2-1 to 2-4."""
_NUMERICAL_RANK = 1e-10
# With one degree of freedom.
_MEDIAN_OF_CHI_SQUARE = 0.4549


def suggest_order(singular_values: FloatArray, largest: int) -> int:
    """Return the order before the widest gap of singular values (2-22), at most `largest`."""
    floor = np.finfo(float).eps * singular_values[0]
    values = np.maximum(singular_values[: largest + 1], floor)
    return int(np.argmax(values[:-1] / values[1:])) + 1


def order_above(threshold: float, space: Subspace) -> int:
    """Return the number of singular values above a part of the largest one (2-22).

    Raises
    ------
    IdentificationError
        If the block rows or the data do not allow as many states.
    """
    values = space.singular_values
    order = int(np.sum(values > threshold * values[0]))
    allowed = min(space.block_rows - 1, space.largest_order)
    if order > allowed:
        raise IdentificationError(
            f"{order} singular values are above singular_value_threshold = {threshold:g}, the "
            f"largest order is {allowed}: raise the threshold or block_rows"
        )
    return order


def largest_order(space: Subspace) -> int:
    """Return the largest order to try: 36 as in the thesis, less where the data limit it."""
    allowed = min(LARGEST_ORDER, space.block_rows - 1, space.largest_order)
    rank = int(np.sum(space.singular_values > _NUMERICAL_RANK * space.singular_values[0]))
    return max(1, min(allowed, rank))


def candidate_orders(space: Subspace) -> range:
    """Return the orders to try: 7 to 36 as in the thesis, fewer where the data limit them."""
    largest = largest_order(space)
    return range(min(SMALLEST_ORDER, largest), largest + 1)


def stable_orders(space: Subspace, orders: Iterable[int]) -> tuple[int, ...]:
    """Return the orders whose model is stable, as listed in Tables 2-1 to 2-4."""
    return tuple(order for order in orders if is_stable(space.matrices(order).A))


def choose_order(
    gram: BlockGram,
    space: Subspace,
    records: Sequence[IoData],
    *,
    stable: bool = True,
    feedthrough: bool = False,
) -> int:
    """Return the order of the one-step predictor by an information criterion.

    The states of PBSID-opt give the one-step errors of each order. The chosen order minimises
    ``N log det S + c n (2 m + r) log N``: `S` is the covariance of the errors over `N` columns,
    `n (2 m + r)` the number of parameters, and `c = 1` would be BIC. BIC assumes white Gaussian
    errors. With friction the errors come in bursts and carry less information than `N` samples
    would. The likelihood is therefore divided by its overdispersion `c`, at least 1: the variance
    of the errors' power over segments of the records, relative to that of white Gaussian noise.

    Schwarz, "Estimating the dimension of a model", Annals of Statistics 6 (1978); Lebreton,
    Burnham, Clobert, Anderson, "Modeling survival and testing biological hypotheses using marked
    animals", Ecological Monographs 62 (1992), for the overdispersion.

    Parameters
    ----------
    gram : BlockGram
        Products of the data.
    space : Subspace
        Models of the estimator; its orders are the candidates.
    records : sequence of IoData
        The records or leading parts of them, for the scatter of the errors.
    stable : bool
        Whether unstable eigenvalues will be moved. Otherwise orders with a stable model take
        precedence.
    feedthrough : bool
        Whether D is fitted.
    """
    orders = candidate_orders(space)
    past = past_length(gram, feedthrough=feedthrough)
    window = gram.leading(past + 1)
    predictor = predictor_space(window, feedthrough=feedthrough)
    candidates = tuple(orders) if stable else stable_orders(space, orders) or tuple(orders)
    known = [order for order in candidates if order <= predictor.largest_order]
    if not known:
        return candidates[0]
    scatter = overdispersion(predictor, known[-1], window, records)
    penalty = scatter * (2 * gram.outputs + gram.inputs) * np.log(gram.columns)
    criteria = []
    for order in known:
        covariance = predictor.innovation_covariance(order, window)
        likelihood = gram.columns * float(np.linalg.slogdet(covariance)[1])
        criteria.append(likelihood + penalty * order)
    return known[int(np.argmin(criteria))]


def overdispersion(
    predictor: PredictorSpace, order: int, gram: BlockGram, records: Sequence[IoData]
) -> float:
    """Return the scatter of the one-step errors' power in units of white Gaussian noise, 1 or more.

    It is taken over segments of the records, for a predictor of one order and the products that it
    was made from. Records with long holes are judged by medians: a frozen command moves the rig,
    and a single segment then has many times the errors of the others. Records too short for
    segments give 1.
    """
    try:
        parts = cut(records, gram.block_rows)
    except DataError:
        return 1.0  # too short to tell
    weight = np.linalg.inv(predictor.innovation_covariance(order, gram))
    grams = segment_grams(records, gram.block_rows, parts)
    power = np.array(
        [np.sum(weight * predictor.innovation_covariance(order, each)) for each in grams]
    )
    columns = np.array([each.columns for each in grams])
    # The power of m white Gaussian channels, each of variance 1, over d samples: variance 2 m / d.
    if not all(record.usable.all() for record in records):
        ratio = columns * (power - np.median(power)) ** 2 / (2.0 * gram.outputs)
        return max(1.0, float(np.median(ratio)) / _MEDIAN_OF_CHI_SQUARE)
    mean = power @ columns / columns.sum()
    ratio = columns * (power - mean) ** 2 / (2.0 * gram.outputs)
    return max(1.0, float(ratio.sum() / (len(parts) - 1)))
