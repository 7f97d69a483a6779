"""Cost of each step of a reduction: full model, kept modes, refitted B or C (Table 3-1b)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.fitting.validation import (
    about_mean,
    mean_error,
    recover_gains,
    relative_errors,
    validate_dmv,
    validate_sfv,
)
from flexarm_ident.reduction.modal import reduce_model

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.estimation.identification import Identification
    from flexarm_ident.fitting.validation import Gains
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.reduction.modal import Reduction

UPDATES = ("none", "b", "c")


@dataclass(frozen=True, eq=False)
class StepCost:
    """Errors of one model between the full and the updated one.

    Attributes
    ----------
    ranking : {'mrm', 'msv', 'mrmc'} or None
        Ranking of the modes; None for the full model.
    update : {'none', 'b', 'c'}
        Matrix that was refitted.
    kept : tuple of str
        Labels of the modes.
    order : int
        Number of states.
    errors : ndarray, (outputs,)
        Errors of data matching over all records together, as of `Outcome`.
    sfv : float or None
        Mean error of set-point following on the first record; None where it does not apply.
    """

    ranking: str | None
    update: str
    kept: tuple[str, ...]
    order: int
    errors: FloatArray
    sfv: float | None

    @property
    def mean(self) -> float:
        """Mean error of data matching."""
        return mean_error(self.errors)


def step_costs(
    identification: Identification,
    records: Sequence[IoData],
    *,
    order: int,
    known_modes_hz: Sequence[float] = (),
) -> tuple[StepCost, ...]:
    """Return the costs of the full model and of all rankings and updates, three to each ranking.

    The identification's own records determine modes and updates.

    Parameters
    ----------
    identification : Identification
        The full model.
    records : sequence of IoData
        Records for the errors; for a model with friction those of `net_records`.
    order : int
        States to keep.
    known_modes_hz : sequence of float
        Known frequencies; if the order has room for them, 'mrmc' is compared too.
    """
    model = identification.model
    labels = tuple(mode.label for mode in identification.modes)
    law = recover_gains(records[0])

    def cost(
        model: control.StateSpace, ranking: str | None, update: str, kept: tuple[str, ...]
    ) -> StepCost:
        errors, sfv = _errors(model, records), _following(model, records[0], law)
        return StepCost(ranking, update, kept, model.nstates, errors, sfv)

    costs = [cost(model, None, "none", labels)]
    for ranking, update in product(rankings(order, known_modes_hz, model.nstates), UPDATES):
        reduced = _reduced(identification, ranking, update, order, known_modes_hz)
        costs.append(cost(reduced.model, ranking, update, reduced.kept))
    return tuple(costs)


def cost_over_orders(
    identification: Identification,
    records: Sequence[IoData],
    orders: Sequence[int],
    *,
    ranking: str,
    update: str,
    known_modes_hz: Sequence[float] = (),
) -> tuple[tuple[int, float], ...]:
    """Return order and mean error of one ranking and update at several orders, rising.

    Parameters
    ----------
    identification, records, known_modes_hz
        As in `step_costs`.
    orders : sequence of int
        States to keep; orders with too little room for the known modes are left out.
    ranking, update
        As in `reduce_model`.
    """
    costs = {}
    for order in orders:
        if ranking in rankings(order, known_modes_hz, identification.order):
            reduced = _reduced(identification, ranking, update, order, known_modes_hz)
            costs[reduced.order] = mean_error(_errors(reduced.model, records))
    return tuple(sorted(costs.items()))


def rankings(order: int, known_modes_hz: Sequence[float], most: int) -> tuple[str, ...]:
    """Return the rankings for which an order has room: all that a model of `most` states has."""
    room = 0 < min(2 * len(known_modes_hz), most) <= order
    return ("mrm", "msv", "mrmc") if room else ("mrm", "msv")


def _reduced(
    identification: Identification,
    ranking: str,
    update: str,
    order: int,
    known_modes_hz: Sequence[float],
) -> Reduction:
    return reduce_model(
        identification,
        identification.linear_records,
        ranking=ranking,  # type: ignore[arg-type]
        order=order,
        known_modes_hz=known_modes_hz,
        update=update,  # type: ignore[arg-type]
    )


def _errors(model: control.StateSpace, records: Sequence[IoData]) -> FloatArray:
    simulated = [validate_dmv(model, record).y for record in records]
    measured = np.vstack([record.y_measured for record in records])
    return about_mean(relative_errors(measured, np.vstack(simulated)), measured)


def _following(model: control.StateSpace, record: IoData, law: Gains | None) -> float | None:
    if law is None:
        return None
    try:
        return mean_error(validate_sfv(model, record, law).error)
    except IdentificationError:
        return None
