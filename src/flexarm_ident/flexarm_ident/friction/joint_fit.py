"""Linear model with dry friction at its joints, fitted to one record from a linear start.

A linear model that was identified from an arm with friction is biased, and simulated freely with
friction it soon is somewhere else. It is therefore fitted by its prediction first, guided by the
measured outputs with a steady Kalman gain. The noise that the gain expects at the inputs is lowered
step by step, which lengthens the memory of the prediction, until it is none: then the prediction is
the free simulation. All matrices, the levels of Coulomb, how the friction yields below them and the
map to the joints' speeds are fitted together; at last, the map has no speed for a joint at rest.
Nothing asks which outputs are fast or slow, so that gyroscopes and accelerometers are outputs like
others.

Ljung, "System Identification", 2nd ed., Prentice Hall (1999), section 7.2, for prediction errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Minimum, step_reporter
from flexarm_ident.fitting.output_fit import fit_initial_states, fit_inputs
from flexarm_ident.fitting.validation import relative_errors
from flexarm_ident.friction.dry_friction import DryFriction, Yielding, simulate_with_friction
from flexarm_ident.friction.guided_error import GuidedError
from flexarm_ident.friction.levels import SYSTEMATIC
from flexarm_ident.models.state_space import simulate, state_space, with_matrices

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.records.iodata import IoData

    Start = tuple[control.StateSpace, FloatArray]

# Noise that the gain expects at an input, in units of its peak.
_STEPS = (6e-3, 1.8e-3, 6e-4, 1.8e-4, 6e-5, 1.8e-5, 6e-6)
# Steps with so much noise see no more in a longer record. The first ones compare the starts.
_SHORT, _SHORT_SAMPLES = 1e-4, 8000
_COMPARED, _COMPARED_SAMPLES = 2, 4000
# A higher order, or a stiffness of the joints, is for a cost that is lower by this factor. The
# search among orders ends after as many that are not, and tries as many starts. It goes on for
# twice as many while the prediction misses more than this, in units of what the past does not tell:
# a delay takes states of its own.
_WORTH, _TRIED, _MISSED = 2.0, 2, 1.5
_PAST = 20
# Prediction errors that end the search, in units of what the past does not tell.
_LOST = 10.0
# Spread, over the outputs, of the logarithm of what is missed beyond that.
_DRIFTS = np.log(10.0)
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
    def left_out_means(self) -> tuple[float, float]:
        """Geometric means over the outputs of what was left out, with friction and without.

        Each output counts by its ratio, whatever its size: the position of a second link drifts
        with any linear model, since its inertia changes with the angle.
        """
        errors = np.array([self.left_out, self.linear_left_out])
        own, linear = np.exp(np.nanmean(np.log(errors), axis=1))
        return float(own), float(linear)

    @property
    def is_better(self) -> bool:
        """Whether friction simulates what was left out better than the linear model does."""
        own, linear = self.left_out_means
        return own < linear


def fit_joints(
    linear: control.StateSpace,
    starts: Iterable[Iterable[Start]],
    record: IoData,
    drives: Sequence[Drive],
    levels: FloatArray,
    *,
    progress: Progress | None = None,
) -> JointFit | None:
    """Fit a linear model with dry friction to a record.

    Orders are compared by what the first, most guided steps miss. The lowest of those that miss
    nearly the least are freed of guidance, and the better free simulation counts, without stiffness
    of the joints unless that misses much more.

    Parameters
    ----------
    linear : control.StateSpace
        Linear model that the result is compared with.
    starts : iterable of iterables of (control.StateSpace, ndarray)
        Linear models of rising order with a basis of eigenvectors, and their initial states,
        (states,). Of those of one order the next is tried where the one before misses much. A
        feedthrough is left out of the fit.
    record : IoData
        Record without holes.
    drives : sequence of Drive
        An output that measures the speed of the joint of each input.
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
    report = step_reporter(progress, "friction", _TRIED * len(_STEPS))
    tried = [_freed(found, leading, report) for found in compared[:_TRIED]]
    if not tried:
        return None
    best = _loosened(min(tried, key=lambda found: found.cost))
    problem, theta = best.problem, best.minimum.theta
    problem.record = record
    found = problem.free_minimum(problem.stand(theta))
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

    problem: GuidedError
    minimum: Minimum
    cost: float


def _compared(
    starts: Iterable[Iterable[Start]],
    leading: IoData,
    drives: Sequence[Drive],
    levels: FloatArray,
    weight: FloatArray,
) -> list[_Found]:
    """Return starts after the first steps, those to try first at the beginning."""
    found: list[_Found] = []
    least, idle, short = np.inf, 0, leading.head(_COMPARED_SAMPLES)

    def guided(start: Start) -> _Found:
        model, x0 = _own_start(*start, leading)
        problem = GuidedError(model, short, levels, drives)
        problem.weight = weight
        minimum = Minimum(problem.start(x0, levels), np.inf, np.eye(0))
        for part in _STEPS[:_COMPARED]:
            minimum = problem.guided_minimum(minimum.theta, part)
        return _Found(problem, minimum, minimum.cost)

    for of_order in starts:
        tried: list[_Found] = []
        for start in of_order:
            tried.append(guided(start))
            if tried[-1].cost < _WORTH**2 * short.y.size:
                break
        cost = min((each.cost for each in tried), default=np.inf)
        if np.isfinite(cost):
            found.append(min(tried, key=lambda each: each.cost))
        idle = 0 if cost < least / _WORTH else idle + 1
        least = min(least, cost)
        missed = (least / short.y.size) ** 0.5
        if idle >= (_TRIED if missed < _MISSED else 2 * _TRIED) and missed < _LOST:
            break
    return sorted(found, key=lambda each: (max(each.cost, _WORTH * least), each.problem.n))


def _freed(start: _Found, leading: IoData, report: Callable[[], None]) -> _Found:
    """Return the parameters whose free simulation is the best on the way to no guidance."""
    problem, best = start.problem, start._replace(cost=np.inf)
    theta = start.minimum.theta
    for part in _STEPS[_COMPARED - 1 :]:
        problem.record = leading.head(_SHORT_SAMPLES) if part > _SHORT else leading
        minimum = problem.guided_minimum(problem.integrate(theta), part)
        report()
        theta, samples = minimum.theta, problem.record.y.size
        problem.record = leading
        misfit = problem.misfit(theta)
        if misfit < best.cost:
            best = _Found(problem, minimum, misfit)
        if not minimum.cost <= _LOST**2 * samples:
            break
    weight, ends = problem.weight, [best]
    for holding in (False, True):
        problem.weight = weight
        found = problem.free_minimum(best.minimum.theta, holding=holding)
        ends.append(_Found(problem, found, problem.misfit(found.theta)))
        # Nothing holds a hub that drifts, beside outputs at their noise.
        if np.ptp(np.log(problem.weight / weight)) < _DRIFTS:
            break
    report()
    return min(ends, key=lambda end: end.cost)


def _loosened(found: _Found) -> _Found:
    """Return the parameters without stiffness of the joints, unless they miss much more.

    A small stiffness makes up for what no linear model has, such as an inertia that changes with
    the angle of a second link, and holds a joint that nothing holds.
    """
    problem, weight = found.problem, found.problem.weight
    minimum = problem.free_minimum(problem.loosen(found.minimum.theta))
    loose = _Found(problem, minimum, problem.misfit(minimum.theta))
    if loose.cost <= found.cost + problem.m * np.log(_WORTH):
        return loose
    problem.weight = weight
    return found


def _own_start(
    model: control.StateSpace, x0: FloatArray, record: IoData
) -> tuple[control.StateSpace, FloatArray]:
    """Return the start of the search with its initial state, without feedthrough.

    Friction acts within the sample as well, and D is its image in a linear model.
    """
    if not np.any(model.D):
        return model, x0
    fit = fit_inputs(model.A, model.C, [record])
    return with_matrices(model, B=fit.B, D=np.zeros_like(model.D)), fit.x0[0]


def _innovation(record: IoData) -> FloatArray:
    """Return the RMS of what the past of a record does not tell about its outputs, (outputs,)."""
    z = np.hstack([record.y, record.u])
    past = np.hstack([z[_PAST - lag : len(z) - lag] for lag in range(1, _PAST + 1)])
    present = record.y[_PAST:]
    left = present - past @ np.linalg.lstsq(past, present, rcond=None)[0]
    return np.asarray(np.maximum(left.std(axis=0), 1e-9 * record.y.std(axis=0)))


def _result(
    problem: GuidedError,
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
