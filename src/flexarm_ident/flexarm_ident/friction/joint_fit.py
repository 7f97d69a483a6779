"""Linear model with dry friction at its joints, fitted to one record from a linear start.

A linear model that was identified from an arm with friction is biased, and simulated freely with
friction it soon is somewhere else. It is therefore fitted by its prediction first, guided by the
measured outputs with a steady Kalman gain. The noise that the gain expects at the inputs is lowered
step by step, which lengthens the memory of the prediction, until it is none: then the prediction is
the free simulation. All matrices, the levels of Coulomb, how the friction yields below them and the
map to the joints' speeds are fitted together. Nothing asks which outputs are fast or slow, so that
gyroscopes and accelerometers are outputs like others.

Ljung, "System Identification", 2nd ed., Prentice Hall (1999), section 7.2, for prediction errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_ident.fitting.levenberg_marquardt import Minimum, Normal, steps_told
from flexarm_ident.fitting.modal_parameters import ModalParameters
from flexarm_ident.fitting.output_fit import fit_initial_states, fit_inputs
from flexarm_ident.fitting.validation import relative_errors
from flexarm_ident.friction.dry_friction import DryFriction, Yielding, simulate_with_friction
from flexarm_ident.friction.layout import drive_columns
from flexarm_ident.friction.levels import SIGNIFICANT, SYSTEMATIC
from flexarm_ident.models.free_run import simulate
from flexarm_ident.models.state_space import (
    INTEGRATOR_RADIUS,
    NEAR_ONE,
    state_space,
    with_matrices,
)
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.records.iodata import IoData

# Noise that the gain expects at an input, in units of its peak.
_STEPS = (6e-3, 1.8e-3, 6e-4, 1.8e-4, 6e-5, 1.8e-5, 6e-6, 0.0)
# Steps with so much noise see no more in a longer record. The first ones compare the starts.
_SHORT, _SHORT_SAMPLES = 1e-4, 8000
_COMPARED, _COMPARED_SAMPLES = 2, 4000
_ITERATIONS, _FIRST_ITERATIONS = 7, 15
_TOLERANCE = 2e-4
# A higher order is for a cost that is lower by this factor; the search among orders ends after as
# many that are not, and tries as many starts.
_WORTH, _TRIED = 2.0, 2
# Rows in which a guided prediction settles.
_SETTLING = 50
# Distance from 1 of the eigenvalues of a joint's rigid motion, at most.
_SLOW_MOTION = 2e-3
_CHUNK = 1024
_PAST = 20
# A start: friction that takes half of the speed in a sample, and nearly all of the rest.
_REST, _GIVE = 0.5, 0.05
_LARGEST_REST, _LARGEST_GIVE = 0.995, 0.5
# Part of the start's level that a search keeps at least, since no friction has no slope.
_LEAST = 0.02
# A guided model may grow.
_GROWTH = 1.003
# Prediction errors that end the search, in units of what the past does not tell.
_LOST = 10.0
# Part of the record that chooses; the rest judges.
_LEADING = 0.6


class JointFit(NamedTuple):
    """Linear model with friction at its joints.

    Attributes
    ----------
    model : control.StateSpace
        Discrete model from the net input.
    x0 : ndarray, (states,)
        Initial state of the record.
    friction : DryFriction
        Friction at its inputs.
    error : ndarray, (outputs,)
        Relative error (2-25) of the free simulation of the record.
    left_out : ndarray, (outputs,)
        The same over the last part of the record, of a model that was fitted to the others.
    linear_left_out : ndarray, (outputs,)
        The same of the linear start, which was fitted to all of it.
    """

    model: control.StateSpace
    x0: FloatArray
    friction: DryFriction
    error: FloatArray
    left_out: FloatArray
    linear_left_out: FloatArray

    @property
    def is_better(self) -> bool:
        """Whether friction simulates what was left out better than the linear model does."""
        return bool(np.nansum(self.left_out**2) < np.nansum(self.linear_left_out**2))


class _GuidedError(ModalParameters):
    """Prediction error over modal parameters, initial state and friction."""

    def __init__(
        self, model: control.StateSpace, record: IoData, levels: FloatArray, drives: Sequence[Drive]
    ) -> None:
        super().__init__(model)
        self.record, self.weight = record, np.ones(self.m)
        self.gain = np.zeros((self.n, self.m))
        self._integrators: list[int] = []
        self._pair = np.arange(self.n)
        for group in self.groups:
            if len(group) > 1:
                self._pair[list(group)] = group[::-1]
        self._least = _LEAST * levels
        self._size = self.n * (2 + self.r + self.m)
        self._drives = drives

    def start(self, x0: FloatArray, levels: FloatArray) -> FloatArray:
        """Return the parameters of the start."""
        theta = self.pack([x0])
        A, _, C, _ = self.split(theta)
        rates = np.zeros((self.n, self.n))
        for group in self.groups:
            at = np.ix_(group, group)
            pole = complex(A[group[0], group[0]], A[group[0], group[-1]] * (len(group) > 1))
            rate = np.log(pole if len(group) > 1 else max(pole.real, 1e-3)) / self.record.dt_s
            turn = np.array([[0.0, 1.0], [-1.0, 0.0]])[: len(group), : len(group)]
            rates[at] = rate.real * np.eye(len(group)) + np.imag(rate) * turn
        speed = np.zeros((self.r, self.n))
        for drive in self._drives:
            given, output = drive_columns(self.record, drive)
            speed[given] = C[output] if drive.is_speed else C[output] @ rates
        ones = np.ones(self.r)
        law = [levels, _REST * ones, _GIVE * ones, 0.0 * ones]
        return np.concatenate([theta, *law, speed.ravel()])

    def split(
        self, theta: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[FloatArray, ...]]:
        """Return A, B, C and the initial state in modal coordinates."""
        return super().split(theta[: self._size])

    def friction(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return levels, rests, gives and offsets, (4, inputs), and speeds, (inputs, states)."""
        own = theta[self._size :]
        return own[: 4 * self.r].reshape(4, self.r), own[4 * self.r :].reshape(self.r, self.n)

    def integrate(self, theta: FloatArray) -> FloatArray:
        """Return parameters whose eigenvalues next to 1 are 1 and stay there."""
        changed = theta.copy()
        self._integrators = [
            group[0]
            for group in self.groups
            if len(group) == 1 and abs(theta[group[0]] - 1.0) < NEAR_ONE
        ]
        changed[self._integrators] = INTEGRATOR_RADIUS
        return changed

    def guide(self, theta: FloatArray, part: float) -> None:
        """Take the gain for noise at the inputs, a part of their peaks; 0: none."""
        self._largest = _GROWTH if part else INTEGRATOR_RADIUS
        if not part:
            self.gain = np.zeros((self.n, self.m))
            return
        A, B, C, _ = self.split(theta)
        driven = B * (part * np.abs(self.record.u).max(axis=0))
        noise = driven @ driven.T
        noise += 1e-10 * np.diag(np.diag(noise))
        measured = np.diag(self.weight**-2.0)
        P = scipy.linalg.solve_discrete_are(A.T, C.T, noise, measured)
        self.gain = np.ascontiguousarray(P @ C.T @ np.linalg.inv(C @ P @ C.T + measured))

    def guided_minimum(self, theta: FloatArray, part: float, iterations: int) -> Minimum:
        """Return the minimum that is found with the gain of `guide`, of infinite cost for none."""
        try:
            self.guide(theta, part)
        except (np.linalg.LinAlgError, ValueError):
            return Minimum(theta, np.inf, np.eye(len(theta)))
        return self.minimised(theta, iterations=iterations, tolerance=_TOLERANCE)

    def allowed(self, theta: FloatArray) -> FloatArray:
        """Return parameters within their bounds, the others unchanged."""
        found = super().allowed(theta)
        law, _ = self.friction(found)
        law[0] = np.maximum(law[0], self._least)
        law[1] = np.clip(law[1], 0.0, _LARGEST_REST)
        law[2] = np.clip(law[2], 0.0, _LARGEST_GIVE)
        return found

    def errors(self, theta: FloatArray) -> FloatArray:
        """Return what the prediction misses, (samples, outputs)."""
        return np.concatenate(
            [found[:, :, -1] for found in self._found(theta, np.zeros((self.n, 0)))]
        )

    def cost(self, theta: FloatArray) -> float:
        """Return the sum of squares."""
        with np.errstate(over="ignore", invalid="ignore"):
            return float(np.sum((self.weight * self.errors(theta)[self._first :]) ** 2))

    def normal(self, theta: FloatArray) -> Normal:
        """Return cost, gradient and the product of the Jacobian with itself."""
        count, first = len(theta), self._first
        slopes = np.zeros((self.n, count))
        slopes[:, self._size - self.n : self._size] = np.eye(self.n)
        total = np.zeros((count + 1, count + 1))
        with np.errstate(over="ignore", invalid="ignore"):
            for found in self._found(theta, slopes):
                rows = (self.weight[:, np.newaxis] * found[first:]).reshape(-1, count + 1)
                total += rows.T @ rows
                first = 0
        total[self._integrators] = total[:, self._integrators] = 0.0
        # The derivatives are those of the prediction, and so less those of the errors.
        return Normal(float(total[-1, -1]), -total[:-1, -1], total[:-1, :-1])

    def deviations(self, found: Minimum) -> FloatArray:
        """Return the standard deviations of the parameters of a minimum."""
        root = truncated_inverse(found.matrix, smallest=1e-12, equilibrated=True).root
        return np.asarray(np.sqrt(found.cost / self.record.y.size * np.sum(root**2, axis=1)))

    def has_friction(self, found: Minimum) -> bool:
        """Return whether a level of a minimum is significant, beyond the least one of a search."""
        (levels, *_), _ = self.friction(found.theta)
        (scatter, *_), _ = self.friction(self.deviations(found))
        return bool(np.any(levels - self._least > SIGNIFICANT * scatter))

    @property
    def _first(self) -> int:
        return _SETTLING if self.gain.any() else 0

    def _found(self, theta: FloatArray, slopes: FloatArray) -> Iterator[FloatArray]:
        """Yield `guided_steps` of a chunk after the other."""
        from flexarm_ident.friction.guided_steps import guided_steps  # noqa: PLC0415 - numba loads slowly

        A, B, C, (x0,) = self.split(theta)
        law, speed = self.friction(theta)
        now, u = x0.copy(), self.record.u - law[3]
        for start in range(0, len(u), _CHUNK):
            rows = slice(start, start + _CHUNK)
            yield guided_steps(
                *(A, B, C, self._pair, self.gain, speed, law[:3]),
                *(u[rows], np.ascontiguousarray(self.record.y[rows]), now, slopes),
            )


def fit_joints(
    linear: control.StateSpace,
    starts: Iterable[tuple[control.StateSpace, FloatArray]],
    record: IoData,
    drives: Sequence[Drive],
    levels: FloatArray,
    *,
    progress: Progress | None = None,
) -> JointFit | None:
    """Fit a linear model with dry friction to a record.

    Orders are compared by what the first, most guided steps miss. The lowest of those that miss
    nearly the least are freed of guidance, and the better free simulation counts.

    Parameters
    ----------
    linear : control.StateSpace
        Linear model that the result is compared with.
    starts : iterable of (control.StateSpace, ndarray)
        Linear models of rising order with a basis of eigenvectors, and their initial states,
        (states,). A feedthrough is left out of the fit.
    record : IoData
        Record without holes.
    drives : sequence of Drive
        An output that tells the speed of the joint of each input.
    levels : ndarray, (inputs,)
        Levels to start from.
    progress : callable, optional
        Called with the stage "friction" and the completed part.

    Returns
    -------
    JointFit or None
        None where the search comes to no finite simulation, or the best prediction does without
        friction, with no level above three of its deviations.
    """
    leading = record.head(round(_LEADING * len(record)))
    weight = 1.0 / _innovation(record)
    compared = [
        found
        for found in _compared(starts, leading, drives, levels, weight)
        if found.problem.has_friction(found.minimum)
    ]
    told = steps_told(progress, "friction", _TRIED * len(_STEPS))
    tried = [_freed(found, leading, told) for found in compared[:_TRIED]]
    if not tried:
        return None
    best = min(tried, key=lambda found: found.cost)
    problem, theta = best.problem, best.minimum.theta
    problem.record = record
    found = problem.minimised(theta, iterations=_ITERATIONS, tolerance=_TOLERANCE)
    if not np.isfinite(found.cost):
        return None
    rest = slice(len(leading), None)
    y = record.y[rest]
    with np.errstate(over="ignore", invalid="ignore"):
        simulated = y - problem.errors(theta)[rest]
    compared_y = simulate(linear, record.u, fit_initial_states(linear, [record])[0])[rest]
    return _result(
        *(problem, found, theta),
        *(relative_errors(y, simulated), relative_errors(y, compared_y)),
    )


class _Found(NamedTuple):
    """Parameters of one start, and the cost that they are judged by."""

    problem: _GuidedError
    minimum: Minimum
    cost: float


def _compared(
    starts: Iterable[tuple[control.StateSpace, FloatArray]],
    leading: IoData,
    drives: Sequence[Drive],
    levels: FloatArray,
    weight: FloatArray,
) -> list[_Found]:
    """Return starts after the first steps, those to try first at the beginning."""
    found: list[_Found] = []
    least, idle, short = np.inf, 0, leading.head(_COMPARED_SAMPLES)
    for model, x0 in starts:
        start, own = _own_start(model, x0, leading)
        problem = _GuidedError(start, short, levels, drives)
        problem.weight = weight
        minimum = Minimum(problem.start(own, levels), np.inf, np.eye(0))
        for part in _STEPS[:_COMPARED]:
            minimum = problem.guided_minimum(minimum.theta, part, _FIRST_ITERATIONS)
        if np.isfinite(minimum.cost):
            found.append(_Found(problem, minimum, minimum.cost))
        idle = 0 if minimum.cost < least / _WORTH else idle + 1
        least = min(least, minimum.cost)
        if idle >= _TRIED and least < _LOST**2 * short.y.size:
            break
    return sorted(found, key=lambda each: (max(each.cost, _WORTH * least), each.problem.n))


def _freed(start: _Found, leading: IoData, told: Callable[[], None]) -> _Found:
    """Return the parameters whose free simulation is the best on the way to no guidance."""
    problem, best = start.problem, start._replace(cost=np.inf)
    theta = start.minimum.theta
    for part in _STEPS[_COMPARED - 1 :]:
        problem.record = leading.head(_SHORT_SAMPLES) if part > _SHORT else leading
        minimum = problem.guided_minimum(problem.integrate(theta), part, _ITERATIONS)
        told()
        theta, samples = minimum.theta, problem.record.y.size
        problem.record = leading
        problem.guide(theta, 0.0)
        cost = problem.cost(theta)
        if cost < best.cost:
            best = _Found(problem, minimum, cost)
        if not minimum.cost <= _LOST**2 * samples:
            break
    return best


def _own_start(
    model: control.StateSpace, x0: FloatArray, record: IoData
) -> tuple[control.StateSpace, FloatArray]:
    """Return the start of the search with its initial state: without feedthrough, and with a pair.

    Friction acts within the sample as well, and D is its image in a linear model.
    """
    A = _rigid_as_pair(model.A)
    if A is model.A and not np.any(model.D):
        return model, x0
    fit = fit_inputs(A, model.C, [record])
    return with_matrices(model, A=A, B=fit.B, D=np.zeros_like(model.D)), fit.x0[0]


def _rigid_as_pair(A: FloatArray) -> FloatArray:
    """Return A with a pair in place of two real eigenvalues next to 1, of the same sum.

    Position and speed of a joint with little viscous friction have nearly the same eigenvector
    there, so that a search for two modes of their own soon loses both.
    """
    T, Z, near = scipy.linalg.schur(
        A, sort=lambda real, imag: imag == 0.0 and abs(real - 1.0) < _SLOW_MOTION
    )
    if near != 2 or T[1, 0] != 0.0 or T[0, 1] == 0.0:  # noqa: PLR2004 (a pair)
        return A
    mean, half = 0.5 * (T[0, 0] + T[1, 1]), 0.5 * abs(T[0, 0] - T[1, 1])
    half = max(half, 1.0 - INTEGRATOR_RADIUS)
    T[0, 0] = T[1, 1] = min(mean, 1.0 - half)
    T[1, 0] = -(half**2) / T[0, 1]
    return np.asarray(Z @ T @ Z.T)


def _innovation(record: IoData) -> FloatArray:
    """Return the RMS of what the past of a record does not tell about its outputs, (outputs,)."""
    z = np.hstack([record.y, record.u])
    past = np.hstack([z[_PAST - lag : len(z) - lag] for lag in range(1, _PAST + 1)])
    present = record.y[_PAST:]
    left = present - past @ np.linalg.lstsq(past, present, rcond=None)[0]
    return np.asarray(np.maximum(left.std(axis=0), 1e-9 * record.y.std(axis=0)))


def _result(
    problem: _GuidedError,
    found: Minimum,
    leading: FloatArray,
    left_out: FloatArray,
    linear: FloatArray,
) -> JointFit:
    """Return the fit, with deviations that hold what the leading part alone gives otherwise."""
    record, theta = problem.record, found.theta
    A, B, C, (x0,) = problem.split(theta)
    law, speed = problem.friction(theta)
    model = state_space(
        *(A, B, C, np.zeros((problem.m, problem.r)), record.dt_s),
        inputs=record.inputs,
        outputs=record.outputs,
    )
    own, _ = problem.friction(np.hypot(problem.deviations(found), theta - leading))
    friction = DryFriction(
        law[0],
        law[3],
        np.hypot(own[0], SYSTEMATIC * law[0]),
        own[3],
        np.ascontiguousarray(speed),
        yielding=Yielding(law[1], law[2]),
    )
    y, _ = simulate_with_friction(model, friction, record.u, x0)
    return JointFit(model, x0, friction, relative_errors(record.y, y), left_out, linear)
