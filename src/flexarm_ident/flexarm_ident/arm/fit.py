"""Flexible arm with dry friction, fitted by simulation to closed-loop records.

The model runs freely under the measured input, and its friction follows from its own speeds. The
fit is therefore exposed to drift exactly as a later simulation is. Every minimum is searched from
several starts, drawn around scales from the record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.arm.equations import FrictionModel
from flexarm_ident.arm.friction_choice import choose_friction
from flexarm_ident.arm.simulation_error import (
    COST_OF_ZERO_ERROR,
    DESCENT,
    EQUALLY_GOOD,
    LAST_STEPS,
    LevelProfile,
    SimulationError,
    descend,
    deviations,
    law_figures,
    profile_levels,
    simulation_error,
)
from flexarm_ident.fitting.blas import one_thread
from flexarm_ident.friction.dry_friction import Dependence, DryFriction, simulate_with_friction
from flexarm_ident.friction.levels import SYSTEMATIC
from flexarm_ident.models.state_space import state_space
from flexarm_ident.records.iodata import as_records
from flexarm_ident.records.signals import bandwidth_hz, live_samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.arm.equations import FlexibleArm
    from flexarm_ident.arm.friction_choice import FrictionChoice
    from flexarm_ident.arm.simulation_error import Part
    from flexarm_ident.fitting.levenberg_marquardt import Minimum
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.records.iodata import IoData

# A zero error of the input of 1 % of its peak costs in a good fit as much as half the error left.
_COST_OF_ERROR_LEFT = 0.5
_LOOSENINGS = 4
_STARTS = 24
_FINALISTS = 6
# Further starts are drawn until two have reached the same minimum.
_BATCHES = 3
_CONFIRMED = 1.01
_FIRST_STEPS = 15
NO_BETTER = "an arm with friction simulates the records no better than the linear model"
"""Reason why an arm is not taken."""
_STANDS_OUT = 3.0
# A cost that rises by 2 % is an error that rises by 1 %.
_NOTHING_LOST = 0.02
# Samples of a record's beginning that tell its first speeds: half a period.
_BEGINNING = 5


@dataclass(frozen=True, eq=False)
class ArmFit:
    """Fitted arm.

    Attributes
    ----------
    model : control.StateSpace
        Discrete model from the net input, at the records' own period.
    x0 : tuple of ndarray, (states,)
        Initial state of each record, fitted with the arm.
    friction : DryFriction
        Coulomb friction and offset of each input.
    error : ndarray, (outputs,)
        Relative error (2-25) of the free simulation of the records, dead samples left out.
    dead_samples : ndarray, (outputs,)
        Number of samples without a working sensor.
    bandwidth_hz : float
        Frequency below which the outputs' power lies.
    law_ranges : ndarray, (inputs, 5, 2)
        Lowest and highest Coulomb level, rise at standstill, speed over which it fades, load, and
        level and rise together, with which the records are simulated equally well.
    free_hubs : tuple of int
        Inputs whose driven position has no stiffness.
    friction_model : FrictionModel
        What the friction depends on.
    left_out : dict of FrictionModel to tuple of float
        Relative errors of the halves that were left out of a fit, by what the friction depends on.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    friction: DryFriction
    error: FloatArray
    dead_samples: FloatArray
    bandwidth_hz: float
    law_ranges: FloatArray
    free_hubs: tuple[int, ...]
    friction_model: FrictionModel
    left_out: dict[FrictionModel, tuple[float, ...]]

    @property
    def has_friction(self) -> bool:
        """Whether the records show the friction.

        A level stands out of its deviation. What the friction depends on was decided by halves left
        out, but trades with the level, whose own deviation is then large.
        """
        levels, deviations = self.friction.levels, self.friction.level_deviations
        return self.friction_model != FrictionModel.COULOMB or bool(
            np.any(levels > _STANDS_OUT * deviations)
        )


@one_thread()
def fit_arm(
    data: IoData | Sequence[IoData],
    drives: Sequence[Drive],
    *,
    error_to_beat: FloatArray | None = None,
    progress: Progress | None = None,
) -> ArmFit:
    """Fit a flexible arm with dry friction to records that start anywhere, at rest or moving.

    Long records are fitted by their leading parts.

    Parameters
    ----------
    data : IoData or sequence of IoData
        Records as measured, without compensation in the input.
    drives : sequence of Drive
        The position that each input drives, one per input.
    error_to_beat : ndarray, (outputs,), optional
        Relative errors (2-25) of another model. The fit ends after its first starts when the best
        of them has a larger sum of squares.
    progress : callable, optional
        Called with the stage "friction" and the completed part.

    Returns
    -------
    ArmFit
        The model, its friction and its simulation errors.

    Raises
    ------
    IdentificationError
        If not every input drives one position, no start gives a finite simulation, or none is
        better than `error_to_beat`.
    """
    report = progress or (lambda _stage, _fraction: None)
    records = as_records(data)
    band_hz = bandwidth_hz(records)
    lives = [live_samples(record) for record in records]
    problem = simulation_error(records, lives, drives, band_hz)
    draw = RandomStarts(problem, band_hz, np.random.default_rng(0))
    finalists: list[Minimum] = []
    for number in range(_BATCHES):
        finalists += _finalists(problem, draw, number, report)
        best = min(finalists, key=lambda found: found.cost)
        _check_best(problem, best, error_to_beat, records[0].label)
        if _is_confirmed(finalists):
            break
    problem, best = _loosened(problem, best)
    reached = choose_friction(problem, (best, *finalists))
    problem, (best, *others) = reached.whole
    if reached.friction_model:
        best = _descended(problem, best.theta)
    freed = without_stiffness(problem, profile_levels(problem, best, others))
    report("friction", 1.0)
    return _result(reached, freed, records, lives, band_hz)


def _finalists(
    problem: SimulationError, draw: RandomStarts, batch: int, report: Progress
) -> list[Minimum]:
    """Return the minima of the most promising starts of one batch."""
    begun, share = batch / _BATCHES, 0.9 / _BATCHES
    tries = []
    for number in range(_STARTS):
        tries.append(descend(problem, draw.start(), iterations=_FIRST_STEPS))
        report("friction", begun + 0.7 * share * (number + 1) / _STARTS)
    tries.sort(key=lambda found: found.cost)
    found = []
    for number, each in enumerate(tries[:_FINALISTS]):
        found.append(_descended(problem, each.theta))
        report("friction", begun + share * (0.7 + 0.3 * (number + 1) / _FINALISTS))
    return found


def _check_best(
    problem: SimulationError, best: Minimum, error_to_beat: FloatArray | None, label: str
) -> None:
    """Raise an IdentificationError when the search would come to nothing."""
    if not np.isfinite(best.cost):
        raise IdentificationError(
            f"{label}: no arm with friction simulates the record: leave friction out"
        )
    if error_to_beat is None:
        return
    left = sum(float(np.sum(e**2)) for e in problem.residuals(best.theta))
    if left > float(np.nansum(error_to_beat**2)):
        raise IdentificationError(NO_BETTER)


def _is_confirmed(minima: Sequence[Minimum]) -> bool:
    """Return whether two starts have reached the lowest cost, or nearly so."""
    lowest, second, *_ = sorted(each.cost for each in minima)
    return second <= _CONFIRMED * lowest


def _loosened(problem: SimulationError, best: Minimum) -> tuple[SimulationError, Minimum]:
    """Weaken the prior of the offsets as far as the fit is better than assumed."""
    strongest = problem.prior
    for _ in range(_LOOSENINGS):
        left = sum(float(np.sum(e**2)) for e in problem.residuals(best.theta))
        error = np.sqrt(left / problem.arm.outputs)
        part = min(1.0, float(_COST_OF_ERROR_LEFT * error / COST_OF_ZERO_ERROR))
        if np.allclose(part * strongest, problem.prior, rtol=0.2):
            break
        problem = replace(problem, prior=part * strongest)
        best = _descended(problem, best.theta)
    return problem, best


def _descended(problem: SimulationError, theta: FloatArray) -> Minimum:
    """Return the minimum after the last, longer search."""
    return descend(problem, theta, iterations=LAST_STEPS)


def _result(
    reached: FrictionChoice,
    freed: Freed,
    records: Sequence[IoData],
    lives: Sequence[FloatArray],
    band_hz: float,
) -> ArmFit:
    problem, (profile, free_hubs), first = reached.whole.problem, freed, records[0]
    best = profile.best
    arm = problem.arm
    A, B = arm.discrete(best.theta, first.dt_s)
    kept, C = observed(problem, best)
    model = state_space(
        *(A[np.ix_(kept, kept)], B[kept], C, np.zeros((arm.outputs, arm.inputs)), first.dt_s),
        inputs=first.inputs,
        outputs=first.outputs,
    )
    friction = _friction(problem, profile, np.ascontiguousarray(arm.speed[:, kept]))
    x0 = tuple(problem.initial_state(best.theta, i)[kept] for i in range(len(records)))
    missed, total = np.zeros(arm.outputs), np.zeros(arm.outputs)
    for record, live, start in zip(records, lives, x0, strict=True):
        y, _ = simulate_with_friction(model, friction, record.u, start)
        missed += np.sum(live * (record.y - y) ** 2, axis=0)
        total += np.sum(live * record.y**2, axis=0)
    error = np.sqrt(np.divide(missed, total, out=np.zeros_like(missed), where=total > 0.0))
    dead = np.sum(
        [
            np.sum((live == 0.0) & ~np.isnan(record.y_measured), axis=0)
            for live, record in zip(lives, records, strict=True)
        ],
        axis=0,
    )
    ranges = np.stack([profile.lowest, profile.highest], axis=-1)
    return ArmFit(
        *(model, x0, friction, error, dead, band_hz, ranges, free_hubs),
        *(reached.friction_model, reached.left_out),
    )


def _friction(problem: SimulationError, profile: LevelProfile, speed: FloatArray) -> DryFriction:
    """Return the friction with deviations from the curvature and from the profile."""
    arm, theta = problem.arm, profile.best.theta
    deviation, laws = deviations(problem, profile.best), arm.laws(theta)
    columns = slice(laws.shape[1])
    scatter = np.maximum(laws - profile.lowest[:, columns], profile.highest[:, columns] - laws)
    for column, name in enumerate(arm.law):
        own = deviation[arm.blocks[name]]
        if len(own):
            by_curvature = laws[:, column] * np.hypot(own, SYSTEMATIC)
            scatter[:, column] = np.maximum(scatter[:, column], by_curvature)
    levels, rises, rise_speeds, loads = laws.T
    dependence = None
    if arm.friction_model:
        dependence = Dependence(rises, rise_speeds, loads, scatter[:, 1], scatter[:, 3])
    offsets, offset_deviations = arm.offsets(theta), deviation[arm.blocks["offset"]]
    return DryFriction(levels, offsets, scatter[:, 0], offset_deviations, speed, dependence)


class Freed(NamedTuple):
    """Profile whose best arm has no stiffness at some hubs, and the numbers of their inputs."""

    profile: LevelProfile
    hubs: tuple[int, ...]


def without_stiffness(problem: SimulationError, profile: LevelProfile) -> Freed:
    """Take out each negative stiffness without which the records are simulated equally well.

    Cables hold a hub by a small stiffness, and a free hub has none. The search may leave a small
    negative one to either, with which the free motion of the arm grows. An arm that gravity turns
    over keeps it.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    profile : LevelProfile
        Its lowest minimum and the laws that are equally good.
    """
    best, hubs, tried = profile.best, list[int](), set[int]()
    first = problem.arm.blocks["stiffness"].start
    places = np.arange(len(best.theta))
    # Without one stiffness, the fit may give another one another sign.
    while left := [hub for hub in _negative(problem, best) if hub not in tried]:
        hub = left[0]
        tried.add(hub)
        theta = best.theta.copy()
        theta[first + hub] = 0.0
        free = np.delete(places, [first + each for each in (*hubs, hub)])
        found = descend(problem, theta, iterations=DESCENT, free=free)
        if found.cost <= EQUALLY_GOOD * profile.best.cost:
            # What does not move has no deviation.
            matrix = np.zeros_like(profile.best.matrix)
            matrix[np.ix_(free, free)] = found.matrix
            best = found._replace(matrix=matrix)
            hubs.append(hub)
    own = law_figures(problem.arm.laws(best.theta))
    lowest, highest = np.minimum(profile.lowest, own), np.maximum(profile.highest, own)
    return Freed(LevelProfile(best, lowest, highest), tuple(hubs))


def _negative(problem: SimulationError, best: Minimum) -> list[int]:
    """Return the inputs whose hub has a negative stiffness."""
    found: list[int] = np.flatnonzero(best.theta[problem.arm.blocks["stiffness"]] < 0.0).tolist()
    return found


class Observed(NamedTuple):
    """States of an arm that a model keeps, and how the outputs follow from these.

    Attributes
    ----------
    kept : ndarray of int, (kept,)
        Places of the states.
    C : ndarray, (outputs, kept)
        Output matrix.
    """

    kept: NDArray[np.intp]
    C: FloatArray


def observed(problem: SimulationError, best: Minimum) -> Observed:
    """Return the states without those of filters that can be left out.

    A filter that is much faster than the sampling changes nothing. Its states would be modes
    without a meaning: dead after one sample, or ringing at an alias.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    best : Minimum
        Its minimum.
    """
    arm, states = problem.arm, problem.states(best.theta)
    C, settled = arm.output_matrix.copy(), _settled(arm, best.theta)
    kept = np.ones(arm.states, dtype=np.bool_)
    allowance = _NOTHING_LOST * best.cost
    for number, output in enumerate(arm.elastic):
        before, after = (
            _missed(problem, states, output, row) for row in (C[output], settled[number])
        )
        if after - before <= allowance:
            C[output] = settled[number]
            kept[arm.filter_states(number)] = False
    places = np.flatnonzero(kept)
    return Observed(places, C[:, places])


def _settled(arm: FlexibleArm, theta: FloatArray) -> FloatArray:
    """Return the filtered outputs from the motion alone, (filtered outputs, states)."""
    rows = np.zeros((len(arm.elastic), arm.states))
    rows[:, : arm.motions] = arm.settled(theta)[::2]
    return rows


def _missed(
    problem: SimulationError, states: list[FloatArray], output: int, row: FloatArray
) -> float:
    """Return the weighted squared error of an output that is a row times the states."""
    return sum(
        float(np.sum((part.weight[:, output] * (x @ row - part.y[:, output])) ** 2))
        for part, x in zip(problem.parts, states, strict=True)
    )


class RandomStarts:
    """Parameters of arms at random, around the scales of the records.

    Parameters
    ----------
    problem : SimulationError
        Records and family of models.
    band_hz : float
        Frequency below which the outputs' power lies.
    rng : numpy.random.Generator
        Source of the random numbers.
    """

    def __init__(self, problem: SimulationError, band_hz: float, rng: np.random.Generator) -> None:
        self._arm, self._rng, self._band_hz = problem.arm, rng, band_hz
        self._problem = problem
        driven = list(problem.arm.positions)
        u = np.vstack([part.u for part in problem.parts])
        speed = [np.gradient(part.y[:, driven], problem.dt_s, axis=0) for part in problem.parts]
        acceleration = np.vstack([np.gradient(v, problem.dt_s, axis=0) for v in speed])
        self._u = np.sqrt(np.mean(u**2, axis=0))
        self._speed = problem.usual_speed
        self._acceleration = np.sqrt(np.mean(acceleration**2, axis=0))
        y = np.vstack([part.y for part in problem.parts])
        self._y = np.sqrt(np.mean(y**2, axis=0))
        self._motions = [self._motion(part) for part in problem.parts]

    def start(self) -> FloatArray:
        """Return parameters of an arm and the first motion of each record."""
        arm, r, e = self._arm, self._arm.inputs, len(self._arm.elastic)
        n = r + e
        # Elastic coordinates move by about one, their stiffness is one.
        gain = self._spread(1.0 / self._u, 0.0, 3.0)
        mass = gain * self._spread(self._u / self._acceleration, -2.0, 1.0)
        frequency_hz = self._spread(np.full(e, self._band_hz), -2.0, 0.0)
        diagonal = np.sqrt(np.concatenate([mass, (2.0 * np.pi * frequency_hz) ** -2.0]))
        mixed = self._rng.normal(size=(n, n + 1))
        mixed = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
        viscous = gain * self._spread(self._u / self._speed, -3.0, -1.0)
        damping = np.sqrt(np.concatenate([viscous, 0.04 * diagonal[r:]]))
        theta = np.zeros(arm.parameters)
        lower = np.tril_indices(n)
        root = np.linalg.cholesky(mixed @ mixed.T * np.outer(diagonal, diagonal))
        theta[arm.blocks["mass"]] = root[lower]
        theta[arm.blocks["damping"]] = np.diag(damping)[lower]
        theta[arm.blocks["log_gain"]] = np.log(gain)
        # Gauges of the outputs' size: `_motion` rests on them.
        theta[arm.blocks["gauges"]] = np.diag(self._y[list(arm.elastic)]).ravel()
        bandwidth = 2.0 * np.pi * self._spread(np.full(e, self._band_hz), -1.0, 1.0)
        theta[arm.blocks["log_bandwidth"]] = np.log(bandwidth)
        theta[arm.blocks["log_level"]] = np.log(self._spread(self._u, -1.5, 0.5))
        return np.concatenate([theta, *self._motions])

    def _motion(self, part: Part) -> FloatArray:
        """Return coordinates and speeds at the beginning of a record."""
        times_s = self._problem.dt_s * np.arange(_BEGINNING)
        speed, place = np.polyfit(times_s, part.y[:_BEGINNING], 1)
        elastic = list(self._arm.elastic)
        for change in (place, speed):
            change[elastic] = np.divide(
                change[elastic],
                self._y[elastic],
                out=np.zeros(len(elastic)),
                where=self._y[elastic] > 0.0,
            )
        order = [*self._arm.positions, *elastic]
        motion = np.concatenate([place[order], speed[order]])
        return np.where(self._problem.undetermined(part), 0.0, motion)

    def _spread(self, scale: FloatArray, low: float, high: float) -> FloatArray:
        return np.asarray(scale * np.exp(self._rng.uniform(low, high, len(scale))))
