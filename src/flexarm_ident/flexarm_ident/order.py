"""Choice of the model order: singular values (2-22), stable orders, simulation error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.errors import IdentificationError
from flexarm_ident.output_fit import fit_inputs
from flexarm_ident.poles import is_stable, stabilise

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.iodata import IoData
    from flexarm_ident.orse import Subspace

# Tables 2-1 to 2-4 look at these orders.
SMALLEST_ORDER = 7
LARGEST_ORDER = 36
_NUMERICAL_RANK = 1e-10
_AS_GOOD_AS_BEST = 1.02
_ROUNDING_ERROR = 1e-7


def suggest_order(singular_values: FloatArray, largest: int) -> int:
    """Return the order before the widest gap of the singular values (2-22).

    Parameters
    ----------
    singular_values : ndarray
        Singular values of (2-21), descending.
    largest : int
        Largest order to suggest.

    Returns
    -------
    int
        Order with the largest ratio between its own and the next singular value.
    """
    floor = np.finfo(float).eps * singular_values[0]
    values = np.maximum(singular_values[: largest + 1], floor)
    return int(np.argmax(values[:-1] / values[1:])) + 1


def candidate_orders(space: Subspace) -> range:
    """Return the orders worth trying: 7 to 36 as in the thesis, less where the data allow less."""
    allowed = min(LARGEST_ORDER, space.block_rows - 1, space.largest_order)
    rank = int(np.sum(space.singular_values > _NUMERICAL_RANK * space.singular_values[0]))
    largest = max(1, min(allowed, rank))
    return range(min(SMALLEST_ORDER, largest), largest + 1)


def stable_orders(space: Subspace, orders: Iterable[int]) -> tuple[int, ...]:
    """Return the orders whose model is stable, as Tables 2-1 to 2-4 list them.

    Parameters
    ----------
    space : Subspace
        Base vectors of the range space.
    orders : iterable of int
        Orders to try.

    Returns
    -------
    tuple of int
        The stable ones.
    """
    return tuple(order for order in orders if is_stable(space.matrices(order).A))


def choose_order(
    space: Subspace,
    records: Sequence[IoData],
    *,
    feedthrough: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> int:
    """Return the smallest order that simulates the data as well as the best one, within 2 %.

    All orders share one eigen-decomposition. Only orders with a stable model count; if there is
    none, all do, with their unstable eigenvalues moved.

    Parameters
    ----------
    space : Subspace
        Base vectors of the range space.
    records : sequence of IoData
        Records that the model is fitted to.
    feedthrough : bool
        Whether D is fitted.
    progress : callable, optional
        Called with the stage "order" and the part that is done.

    Returns
    -------
    int
        The order.

    Raises
    ------
    IdentificationError
        If no order gives a finite simulation.
    """
    orders = candidate_orders(space)
    candidates = stable_orders(space, orders) or tuple(orders)
    errors = []
    for done, order in enumerate(candidates):
        matrices = space.matrices(order)
        A, _ = stabilise(matrices.A)
        fit = fit_inputs(A, matrices.C, records, feedthrough=feedthrough)
        errors.append(float(fit.error.mean()))
        if progress is not None:
            progress("order", (done + 1) / len(candidates))
    good = np.array(errors) <= _AS_GOOD_AS_BEST * np.nanmin(errors) + _ROUNDING_ERROR
    if not good.any():
        raise IdentificationError("no order simulates the data: give the order, or other data")
    return int(candidates[int(np.argmax(good))])
