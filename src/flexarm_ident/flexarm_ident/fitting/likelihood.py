"""Maximum likelihood of a whole model whose errors are autoregressive noise.

Model and noise are those of Box and Jenkins: the free simulation, and for each output noise that an
autoregressive model colours. A, B, C and the initial states maximise the likelihood for given
noise, the noise follows from the errors that are left, and so on. With the inverse of the noise's
filter the errors are white, so that the likelihood is a sum of squares; the input may come from a
controller. What holds of maximum likelihood holds for noise alone: where the errors recur with the
input, there is no result.

Ljung, "System Identification", 2nd ed., Prentice Hall (1999), sections 7.4 and 9.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.fitting.levenberg_marquardt import steps_told
from flexarm_ident.fitting.modal_error import ModalError
from flexarm_ident.fitting.noise_filter import is_noise, whitening_filter
from flexarm_ident.models.free_run import simulate
from flexarm_ident.models.modes import (
    ModeUncertainty,
    frequency_and_damping,
    is_defective,
    modal_form,
)
from flexarm_ident.records.iodata import as_records
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.fitting.levenberg_marquardt import Minimum
    from flexarm_ident.records.iodata import IoData

# Fewer say more about the noise than about the model.
_ERRORS_PER_PARAMETER = 20
_ROUNDS = 3
_ITERATIONS = 15


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """Model of maximum likelihood.

    Attributes
    ----------
    model : control.StateSpace
        The model.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    filters : tuple of ndarray, (taps,)
        Filter of each output that makes its errors white, with unit variance.
    modes : tuple of ModeUncertainty
        Modes with the standard deviations of the Cramer-Rao bound, in the order of `modal_form`.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    filters: tuple[FloatArray, ...]
    modes: tuple[ModeUncertainty, ...]


def maximise_likelihood(
    model: control.StateSpace,
    x0: Sequence[FloatArray],
    data: IoData | Sequence[IoData],
    *,
    order_open: bool = False,
    progress: Progress | None = None,
) -> LikelihoodFit | None:
    """Maximise the likelihood over A, B, C and the initial states; D stays.

    Parameters
    ----------
    model : control.StateSpace
        Discrete start.
    x0 : sequence of ndarray, (states,)
        Initial state of each record.
    data : IoData or sequence of IoData
        Records.
    order_open : bool
        Leave out modes, the faintest first, as long as Schwarz's criterion prefers that.
    progress : callable, optional
        Called with the stage "refinement" and the completed part.

    Returns
    -------
    LikelihoodFit or None
        None where the errors are correlated with earlier inputs, so that they are no noise, where
        there are fewer than 20 for each parameter, and where the model has no modal form or
        overflows.
    """
    records = as_records(data)
    starts = tuple(x0)
    parameters = model.nstates * (1 + model.ninputs + model.noutputs + len(starts))
    errors = model.noutputs * sum(int(record.usable.sum()) for record in records)
    if errors < _ERRORS_PER_PARAMETER * parameters:
        return None
    if is_defective(modal_form(model).vectors):
        return None
    on_step = steps_told(progress, "refinement", _ROUNDS * _ITERATIONS)
    for _ in range(_ROUNDS):
        filters = _filters(_errors(model, starts, records))
        problem = ModalError(model, records, filters)
        found = problem.minimised(starts, iterations=_ITERATIONS, on_step=on_step)
        if not np.isfinite(found.cost):
            return None
        model, starts = problem.unpack(found.theta)
    while order_open and (simpler := _simpler(problem, found, filters, records)) is not None:
        problem, found = simpler
    model, starts = problem.unpack(found.theta)
    white = [_white(e, filters) for e in _errors(model, starts, records)]
    if not is_noise(white, [record.u for record in records]):
        return None
    modes = _modes(problem, found.theta, found.matrix, model)
    return LikelihoodFit(model, starts, tuple(filters), modes)


def _simpler(
    problem: ModalError,
    found: Minimum,
    filters: Sequence[FloatArray],
    records: Sequence[IoData],
) -> tuple[ModalError, Minimum] | None:
    """Return the fit without the faintest mode where Schwarz's criterion prefers it.

    A mode too many follows the noise.
    """
    if len(problem.groups) == 1:
        return None
    faintest = problem.groups[int(np.argmin(problem.powers(found.theta)))]
    model, starts = problem.without(found.theta, faintest)
    if is_defective(modal_form(model).vectors):
        return None
    simpler = ModalError(model, records, filters)
    again = simpler.minimised(starts, iterations=_ITERATIONS, on_step=lambda: None)
    errors = sum(int(record.usable.sum()) for record in records) * model.noutputs
    # The scale of a state, and the angle of a pair, are no parameters of the model.
    fewer = len(found.theta) - len(again.theta) - len(faintest)
    return (simpler, again) if again.cost <= found.cost + fewer * np.log(errors) else None


def _errors(
    model: control.StateSpace, starts: Sequence[FloatArray], records: Sequence[IoData]
) -> list[FloatArray]:
    with np.errstate(over="ignore", invalid="ignore"):
        return [
            np.asarray(record.y_usable - simulate(model, record.u, start))
            for record, start in zip(records, starts, strict=True)
        ]


def _filters(errors: Sequence[FloatArray]) -> list[FloatArray]:
    outputs = errors[0].shape[1]
    return [whitening_filter([e[:, output] for e in errors]) for output in range(outputs)]


def _white(errors: FloatArray, filters: Sequence[FloatArray]) -> FloatArray:
    """Return errors behind their filters; NaN where a filter reaches one that is missing."""
    passed = [np.convolve(e, taps)[: len(e)] for e, taps in zip(errors.T, filters, strict=True)]
    return np.stack(passed, axis=1)


def _modes(
    problem: ModalError, theta: FloatArray, information: FloatArray, model: control.StateSpace
) -> tuple[ModeUncertainty, ...]:
    """Return frequencies and damping with deviations, in the order of the model's modal form."""
    inverse = truncated_inverse(information, equilibrated=True)
    covariance = (inverse.vectors / inverse.values) @ inverse.vectors.T
    found = []
    for group in problem.groups:
        entries = list(group)
        eigenvalue = complex(*theta[entries])
        spread = covariance[np.ix_(entries, entries)]
        found.append((eigenvalue, _uncertainty(eigenvalue, spread, float(model.dt))))
    form = modal_form(model)
    own = np.array([form.eigenvalues[group[0]] for group in form.groups])
    distance = np.abs(np.subtract.outer(own, [eigenvalue for eigenvalue, _ in found]))
    _, nearest = scipy.optimize.linear_sum_assignment(distance)
    return tuple(found[each][1] for each in nearest)


def _uncertainty(eigenvalue: complex, covariance: FloatArray, dt_s: float) -> ModeUncertainty:
    """Return a mode with its deviations, by the derivatives of (2-28)."""
    frequency_hz, damping_ratio = frequency_and_damping(eigenvalue, dt_s)
    if len(covariance) == 1:
        return ModeUncertainty(frequency_hz, damping_ratio, 0.0, 0.0)
    rate = np.log(eigenvalue)
    slope = np.array([1.0, 1.0j]) / eigenvalue
    size = (np.conj(rate) * slope).real / abs(rate)
    damping = -slope.real / abs(rate) + rate.real * size / abs(rate) ** 2
    frequency = size / (2.0 * np.pi * dt_s)
    return ModeUncertainty(
        frequency_hz,
        damping_ratio,
        float(np.sqrt(frequency @ covariance @ frequency)),
        float(np.sqrt(damping @ covariance @ damping)),
    )
