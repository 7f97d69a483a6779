"""Refinement of a whole model by its simulation error, from a subspace start.

Subspace methods minimise a projection, and the output fit changes only B and the initial states.
Here A, B, C and the initial states change together, by damped Gauss-Newton steps, to lower the sum
of the squared relative errors (2-25) of the free simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.blas import one_thread
from flexarm_ident.fitting.levenberg_marquardt import step_reporter
from flexarm_ident.fitting.modal_error import ModalError
from flexarm_ident.models.modes import is_defective, modal_form
from flexarm_ident.models.state_space import simulate
from flexarm_ident.records.iodata import as_records

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.records.iodata import IoData

_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Refinement:
    """Refined model, or the start when no better one was found.

    Attributes
    ----------
    model : control.StateSpace
        The model.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    error : ndarray, (outputs,)
        Relative simulation error of each output over the records (2-25).
    start_error : ndarray, (outputs,)
        The same of the start.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    error: FloatArray
    start_error: FloatArray


@one_thread()
def refine_model(
    model: control.StateSpace,
    x0: Sequence[FloatArray],
    data: IoData | Sequence[IoData],
    *,
    iterations: int = _ITERATIONS,
    progress: Progress | None = None,
) -> Refinement:
    """Refine A, B, C and the initial states by simulation error; D stays.

    Parameters
    ----------
    model : control.StateSpace
        Discrete start.
    x0 : sequence of ndarray, (states,)
        Initial state of each record.
    data : IoData or sequence of IoData
        Records.
    iterations : int
        Largest number of steps.
    progress : callable, optional
        Called with the stage "refinement" and the completed part.

    Returns
    -------
    Refinement
        A model whose sum of squared relative errors is not above that of the start. Its largest
        eigenvalue is not beyond both the start's and the unit circle.
    """
    records = as_records(data)
    before = _errors(model, x0, records)
    unchanged = Refinement(model, tuple(x0), before, before)
    if is_defective(modal_form(model).vectors) or not np.isfinite(before).all():
        return unchanged
    problem = ModalError(model, records, relative_weights(records))
    on_step = step_reporter(progress, "refinement", iterations)
    found = problem.minimised(problem.pack(x0), iterations=iterations, on_step=on_step)
    if not np.isfinite(found.cost):
        return unchanged
    refined, starts = problem.unpack(found.theta)
    after = _errors(refined, starts, records)
    # An independent simulation decides, so that rounding cannot make the model worse.
    if not np.sum(after**2) < np.sum(before**2):
        return unchanged
    return Refinement(refined, starts, after, before)


def relative_weights(records: Sequence[IoData]) -> list[FloatArray]:
    """Return filters that weight the errors of each output by the inverse of its RMS."""
    power = np.sum([np.nansum(record.y_usable**2, axis=0) for record in records], axis=0)
    weight = np.sqrt(np.divide(1.0, power, out=np.zeros_like(power), where=power > 0.0))
    return list(weight[:, np.newaxis])


def _errors(
    model: control.StateSpace, x0: Sequence[FloatArray], records: Sequence[IoData]
) -> FloatArray:
    missed, total = np.zeros(model.noutputs), np.zeros(model.noutputs)
    with np.errstate(over="ignore", invalid="ignore"):
        for record, start in zip(records, x0, strict=True):
            y = record.y_measured
            missed += np.nansum((simulate(model, record.u, start) - y) ** 2, axis=0)
            total += np.nansum(y**2, axis=0)
    return np.sqrt(np.divide(missed, total, out=np.zeros_like(missed), where=total > 0.0))
