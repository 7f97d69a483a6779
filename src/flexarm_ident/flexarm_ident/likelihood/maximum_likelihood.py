"""Maximum likelihood of a whole model whose errors are autoregressive noise.

Model and noise are those of Box and Jenkins: the free simulation, and for each output noise that an
autoregressive model colours. A, B, C and the initial states maximise the likelihood for given
noise, and the noise follows from the errors that are left. With the inverse of the noise's filter
the errors are white, so that the likelihood is a sum of squares; the input may come from a
controller. What holds of maximum likelihood holds for noise alone: where the errors recur with the
input, there is no result.

Records without holes are fitted in the frequency domain, in a time that hardly depends on their
length; others sample by sample.

Ljung, "System Identification", 2nd ed., Prentice Hall (1999), sections 7.4 and 9.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import scipy

from flexarm_ident.diagnostics.uncertainty import ResponseUncertainty
from flexarm_ident.fitting.levenberg_marquardt import step_reporter
from flexarm_ident.fitting.modal_error import ModalError
from flexarm_ident.fitting.modal_parameters import PoleForm
from flexarm_ident.fitting.output_fit import fit_initial_states
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.likelihood.noise_filter import is_noise, whitened, whitening_filters
from flexarm_ident.likelihood.spectral_error import SpectralError
from flexarm_ident.models.modes import (
    ModeUncertainty,
    frequency_and_damping,
    is_defective,
    modal_form,
    nearest,
)
from flexarm_ident.models.state_space import BlockSimulation, simulate
from flexarm_ident.records.iodata import as_records
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.fitting.levenberg_marquardt import Minimum
    from flexarm_ident.records.iodata import IoData

    Problem: TypeAlias = "SampledError | SpectralError"

# Fewer say more about the noise than about the model.
_ERRORS_PER_PARAMETER = 20
_ITERATIONS = 15
# Relative decrease of the cost that ends a search before the last one.
_ROUGH = 1e-4
# Steps after which the fit without a mode shows whether the mode is needed: it is where the cost is
# above the limit by so many times what the limit allows.
_FIRST_ITERATIONS = 4
_HOPELESS = 5.0


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """Model of maximum likelihood.

    Attributes
    ----------
    model : control.StateSpace
        The model.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    error : ndarray, (outputs,)
        Relative simulation error of each output over the records (2-25).
    filters : tuple of ndarray, (taps,)
        Filter of each output that makes its errors white, with unit variance.
    modes : tuple of ModeUncertainty
        Modes with the standard deviations of the Cramer-Rao bound, in the order of `modal_form`.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    error: FloatArray
    filters: tuple[FloatArray, ...]
    modes: tuple[ModeUncertainty, ...]
    _parameters: Problem
    _theta: FloatArray
    _covariance: FloatArray

    def response_uncertainty(self, frequencies_hz: FloatArray) -> ResponseUncertainty:
        """Return the frequency response (2-4) with the deviations of the Cramer-Rao bound."""
        z = np.exp(2j * np.pi * np.asarray(frequencies_hz) * float(self.model.dt))
        form, n, r = PoleForm(self._parameters, self._theta), self.model.nstates, self.model.ninputs
        near = 1.0 / (z[:, np.newaxis] - form.poles)
        deviation = np.empty((len(z), self.model.noutputs, r))
        for output, given in np.ndindex(deviation.shape[1:]):
            driven = near * form.beta[given]
            slopes = np.zeros((len(z), n * (r + 3)), dtype=complex)
            slopes[:, :n], slopes[:, -n:] = near * driven, driven
            slopes[:, n * (1 + given) : n * (2 + given)] = near
            slopes = slopes @ form.derivatives(output, r)
            place = self._parameters.columns(output, 0)
            covariance = self._covariance[np.ix_(place, place)]
            variance = np.sum((slopes @ covariance) * slopes.conj(), axis=1).real
            deviation[:, output, given] = np.sqrt(variance.clip(min=0.0))
        grid = np.asarray(frequencies_hz, dtype=np.float64)
        return ResponseUncertainty(grid, frequency_response(self.model, grid), deviation)

    def refitted(self, records: Sequence[IoData]) -> control.StateSpace:
        """Return the model of maximum likelihood of other records, for the same noise."""
        problem = _problem(self.model, records)
        problem.filters = self.filters
        start = problem.start(fit_initial_states(self.model, records))
        found = problem.minimised(start, iterations=_ITERATIONS, on_step=lambda: None)
        return problem.model(found.theta)


def maximise_likelihood(
    model: control.StateSpace,
    x0: Sequence[FloatArray],
    data: IoData | Sequence[IoData],
    *,
    order_open: bool = False,
    at_once: bool = False,
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
    at_once : bool
        Whether an input of the same sample tells the errors from noise as well. A controller may
        answer within the sample.
    progress : callable, optional
        Called with the stage "refinement" and the completed part.

    Returns
    -------
    LikelihoodFit or None
        None where the errors are correlated with earlier inputs, so that they are not noise, where
        there are fewer than 20 for each parameter, and where the model has no modal form or
        overflows.
    """
    records = as_records(data)
    parameters = model.nstates * (1 + model.ninputs + model.noutputs + len(x0))
    samples = model.noutputs * sum(int(record.usable.sum()) for record in records)
    if samples < _ERRORS_PER_PARAMETER * parameters:
        return None
    if is_defective(modal_form(model).vectors):
        return None
    on_step = step_reporter(progress, "refinement", 3 * _ITERATIONS)
    problem = _problem(model, records)
    theta = problem.start(x0)
    problem.settle(theta)
    found = problem.minimised(theta, iterations=_ITERATIONS, tolerance=_ROUGH, on_step=on_step)
    # With modes too many, the noise is known well enough to tell which ones.
    while order_open and (simpler := _simpler(problem, found, samples, on_step)) is not None:
        problem, found = simpler
    if not np.isfinite(found.cost):
        return None
    problem.settle(found.theta)
    found = problem.minimised(found.theta, iterations=_ITERATIONS, on_step=on_step)
    theta = found.theta
    model, starts = problem.unpack(theta)
    filters = problem.filters
    errors = _errors(model, starts, records)
    white = [whitened(e, filters) for e in errors]
    inputs = [record.u for record in records]
    if at_once:
        white, inputs = [e[:-1] for e in white], [u[1:] for u in inputs]
    if not is_noise(white, inputs):
        return None
    root = truncated_inverse(found.matrix, equilibrated=True).root
    covariance = root @ root.T
    modes = _modes(problem, found.theta, covariance, model)
    return LikelihoodFit(
        model,
        starts,
        _relative(errors, records),
        tuple(filters),
        modes,
        problem,
        found.theta,
        covariance,
    )


def _problem(model: control.StateSpace, records: Sequence[IoData]) -> Problem:
    unfiltered = [np.ones(1)] * model.noutputs
    if all(record.usable.all() for record in records):
        return SpectralError(model, records, unfiltered)
    return SampledError(model, records, unfiltered)


def _simpler(
    problem: Problem, found: Minimum, errors: int, on_step: Callable[[], None]
) -> tuple[Problem, Minimum] | None:
    """Return the fit without the faintest mode where Schwarz's criterion prefers it.

    A mode too many follows the noise.
    """
    if len(problem.groups) == 1:
        return None
    faintest = problem.groups[int(np.argmin(problem.powers(found.theta)))]
    simpler, start = problem.simpler(found.theta, faintest)
    # The scale of a state, and the angle of a pair, are not parameters of the model.
    fewer = len(found.theta) - len(start) - len(faintest)
    limit = found.cost + fewer * np.log(errors)
    again = simpler.minimised(start, iterations=_FIRST_ITERATIONS, on_step=on_step)
    if limit < again.cost < limit + _HOPELESS * (limit - found.cost):
        again = simpler.minimised(again.theta, iterations=_ITERATIONS, tolerance=_ROUGH)
    return (simpler, again) if again.cost <= limit else None


def _errors(
    model: control.StateSpace, starts: Sequence[FloatArray], records: Sequence[IoData]
) -> list[FloatArray]:
    with np.errstate(over="ignore", invalid="ignore"):
        return [
            np.asarray(record.y_usable - simulate(model, record.u, start))
            for record, start in zip(records, starts, strict=True)
        ]


def _relative(errors: Sequence[FloatArray], records: Sequence[IoData]) -> FloatArray:
    missed = np.sum([np.nansum(e**2, axis=0) for e in errors], axis=0)
    power = np.sum([np.nansum(record.y_usable**2, axis=0) for record in records], axis=0)
    part = np.divide(missed, power, out=np.full_like(power, np.nan), where=power > 0.0)
    return np.asarray(np.sqrt(part))


def _modes(
    problem: Problem, theta: FloatArray, covariance: FloatArray, model: control.StateSpace
) -> tuple[ModeUncertainty, ...]:
    """Return frequencies and damping with deviations, in the order of the model's modal form."""
    found = []
    for group in problem.groups:
        entries = list(group)
        eigenvalue = complex(*theta[entries])
        spread = covariance[np.ix_(entries, entries)]
        found.append((eigenvalue, _uncertainty(eigenvalue, spread, float(model.dt))))
    form = modal_form(model)
    own = np.array([form.eigenvalues[group[0]] for group in form.groups])
    places = nearest(own, np.array([eigenvalue for eigenvalue, _ in found]))
    return tuple(found[each][1] for each in places)


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


class SampledError(ModalError):
    """Cost and normal equations with what the likelihood asks beside, see `ModalError`."""

    def start(self, x0: Sequence[FloatArray]) -> FloatArray:
        """Return the parameters of the start, with initial states of the records."""
        return self.pack(x0)

    def settle(self, theta: FloatArray) -> None:
        """Make the filters suit the errors of some parameters."""
        model, starts = self.unpack(theta)
        with np.errstate(over="ignore", invalid="ignore"):
            errors = [
                np.asarray(record.y_usable - simulate(model, record.u, start))
                for record, start in zip(self._records, starts, strict=True)
            ]
        self.filters = whitening_filters(errors)

    def simpler(self, theta: FloatArray, group: tuple[int, ...]) -> tuple[SampledError, FloatArray]:
        """Return the problem without one mode, and the parameters that are left."""
        model, starts = self.without(theta, group)
        problem = SampledError(model, self._records, self._filters)
        return problem, problem.pack(starts)

    def powers(self, theta: FloatArray) -> FloatArray:
        """Return the sum of squares that each mode alone gives behind the filters, (modes,)."""
        A, B, C, starts = self.split(theta)
        powers = np.zeros(len(self.groups))
        direct = np.zeros((self.m, self.r))
        for mode, group in enumerate(map(list, self.groups)):
            own = (A[np.ix_(group, group)], B[group], C[:, group], direct)
            for record, start, known in zip(self._records, starts, self._known, strict=True):
                y = BlockSimulation(*own, start[group]).advance(record.u)
                for alone, taps, rows in zip(y.T, self._filters, known, strict=True):
                    passed = scipy.signal.lfilter(taps, [1.0], alone)
                    powers[mode] += float(np.sum(passed[rows] ** 2))
        return powers
