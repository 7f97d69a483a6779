"""Simulation error of a flexible arm with dry friction, its descent, and its profile.

The profile has the laws with which a record is simulated equally well. The curvature of the cost at
one minimum says little where the friction trades with damping and gain, and where the cost has
several minima. Each level, rise and load is therefore moved away from the best fit in steps, all
other parameters are fitted again, and so on until the cost stands out. The laws of other minima
count as well.

Venzon, Moolgavkar, "A method for computing profile-likelihood-based confidence intervals", Applied
Statistics 37 (1988).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.arm.equations import FlexibleArm
from flexarm_ident.fitting.levenberg_marquardt import Minimum, Normal, minimise
from flexarm_ident.friction.layout import drive_columns
from flexarm_ident.records.signals import smoothed
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.records.iodata import IoData

_LEAST_INDEPENDENCE = 0.05
# Part of the load from which friction holds a joint that its load drives.
_SELF_LOCKING = 0.5
# Part of the usual speed over which a rise fades at least.
_LEAST_FADING = 0.01
# Samples per period of the highest frequency, and the anti-alias cut-off by the new rate.
_SAMPLES_PER_PERIOD = 10.0
_ANTI_ALIAS = 0.3
_ZERO_ERROR = 0.01
COST_OF_ZERO_ERROR = 0.05
"""Error of one output that costs as much as a zero error of the input of 1 % of its peak."""
# Samples of all records together at the lower rate; more would take minutes for little more.
_MOST_SAMPLES = 3000
LAST_STEPS = 400
"""Steps after which nothing is left of what a start knew."""
# A cost 10 % above the smallest is an error 5 % above it, less than two halves of a record differ.
EQUALLY_GOOD = 1.1
"""Cost in units of the smallest up to which the records are simulated equally well."""
_MOVED = ("log_level", "log_rise", "log_load")
_STEP = 0.06
_STEPS = 8
_ITERATIONS = 12
DESCENT = 60
_RESTARTS = 2
_LOWER = 0.995


class Part(NamedTuple):
    """Record, smoothed and decimated, with the inputs' sizes and the weights of its residuals."""

    u: FloatArray
    sizes: FloatArray
    y: FloatArray
    weight: FloatArray


@dataclass(frozen=True, eq=False)
class SimulationError:
    """Sum of squared relative errors of the free simulations, and of the offsets' prior.

    The arm's parameters are followed by the initial coordinates and speeds of each record: a record
    may begin anywhere. Where a gauge is dead at the beginning, nothing shows the first deflection,
    which stays what it was at the start of a search.

    Attributes
    ----------
    arm : FlexibleArm
        Family of models.
    parts : tuple of Part
        Records.
    dt_s : float
        Their sampling period.
    prior : ndarray, (inputs,)
        Weight of each offset.
    """

    arm: FlexibleArm
    parts: tuple[Part, ...]
    dt_s: float
    prior: FloatArray

    @cached_property
    def usual_speed(self) -> FloatArray:
        """RMS speed of each driven position in the records, (inputs,)."""
        driven = list(self.arm.positions)
        speed = [np.gradient(part.y[:, driven], self.dt_s, axis=0) for part in self.parts]
        return np.asarray(np.sqrt(np.mean(np.vstack(speed) ** 2, axis=0)))

    def allowed(self, theta: FloatArray) -> FloatArray:
        """Return parameters whose friction can be told apart from a Coulomb level and a gain.

        A rise fades within the usual speed and over some of it, and no joint is self-locking under
        its load.
        """
        allowed, blocks = theta.copy(), self.arm.blocks
        if len(theta[blocks["log_speed"]]):
            usual = np.log(self.usual_speed)
            least = usual + np.log(_LEAST_FADING)
            allowed[blocks["log_speed"]] = np.clip(theta[blocks["log_speed"]], least, usual)
        load = theta[blocks["log_load"]]
        allowed[blocks["log_load"]] = np.minimum(load, np.log(_SELF_LOCKING))
        return allowed

    def initial_state(self, theta: FloatArray, record: int) -> FloatArray:
        """Return the initial state of a record, (states,)."""
        return self.arm.initial_state(theta, theta[self._start(record)])

    def cost(self, theta: FloatArray) -> float:
        """Return the sum; infinite where a simulation overflows."""
        total = float(np.sum((self.prior * self.arm.offsets(theta)) ** 2))
        with np.errstate(all="ignore"):
            total += sum(float(np.sum(e**2)) for e in self.residuals(theta))
        return total if np.isfinite(total) else np.inf

    def residuals(self, theta: FloatArray) -> list[FloatArray]:
        """Return the weighted residuals of each record, (samples, outputs)."""
        return [
            part.weight * (x[:, self.arm.measured] - part.y)
            for part, x in zip(self.parts, self.states(theta), strict=True)
        ]

    def states(self, theta: FloatArray) -> list[FloatArray]:
        """Return the simulated states of each record, (samples, states)."""
        from flexarm_ident.models.stick_slip import run  # noqa: PLC0415 - numba loads slowly

        A, B = self.arm.discrete(theta, self.dt_s)
        laws = self.arm.laws(theta)
        still = np.zeros((self.arm.inputs, 2))
        return [
            run(A, B, self.arm.speed, laws, still, *self._driven(theta, record))[0]
            for record in range(len(self.parts))
        ]

    def normal(self, theta: FloatArray) -> Normal:
        """Return the normal equations."""
        from flexarm_ident.models.stick_slip import run_sensitivity  # noqa: PLC0415 - numba loads slowly

        arm, own, count = self.arm, self.arm.parameters, len(theta)
        nothing = Normal(np.inf, np.zeros(count), np.eye(count))
        with np.errstate(all="ignore"):
            A, B, d_A, d_B = arm.discrete_with_derivatives(theta, self.dt_s)
        if not all(np.isfinite(each).all() for each in (A, B, d_A, d_B)):
            return nothing
        laws, offsets = arm.laws(theta), arm.offsets(theta)
        # Of the initial motions, a record depends on its own alone.
        d_laws = np.zeros((arm.inputs, 4, own + arm.motions))
        d_laws[..., :own] = arm.law_slopes(theta)
        d_u = np.zeros((arm.inputs, own + arm.motions))
        d_u[:, arm.blocks["offset"]] = -np.eye(arm.inputs)
        gradient, matrix = np.zeros(count), np.zeros((count, count))
        gradient[arm.blocks["offset"]] = self.prior**2 * offsets
        matrix[arm.blocks["offset"], arm.blocks["offset"]] = np.diag(self.prior**2)
        cost = float(np.sum((self.prior * offsets) ** 2))
        for i, part in enumerate(self.parts):
            start = self._start(i)
            d_x0 = arm.initial_state_slopes(theta, theta[start])
            d_x0[:, own + np.flatnonzero(self.undetermined(part))] = 0.0
            try:
                x, d_x = run_sensitivity(
                    *(A, B, arm.speed, laws, *self._driven(theta, i)),
                    *(d_A, d_B, d_laws, d_u, d_x0, arm.measured),
                )
            except np.linalg.LinAlgError:
                return nothing
            places = np.r_[:own, start]
            # A wild start overflows; its normal equations are then not finite, and it is dropped.
            with np.errstate(over="ignore", invalid="ignore"):
                residual = (part.weight * (x[:, arm.measured] - part.y)).ravel()
                jacobian = d_x * part.weight[:, :, np.newaxis]
                jacobian = jacobian.reshape(-1, len(places))
                cost += float(residual @ residual)
                gradient[places] += jacobian.T @ residual
                matrix[np.ix_(places, places)] += jacobian.T @ jacobian
        return Normal(cost, gradient, matrix)

    def _driven(self, theta: FloatArray, record: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return net inputs, their sizes and the initial state of a record."""
        part = self.parts[record]
        return part.u - self.arm.offsets(theta), part.sizes, self.initial_state(theta, record)

    def undetermined(self, part: Part) -> BoolArray:
        """Return which first coordinates and speeds nothing determines, (motions,)."""
        driven = np.zeros(self.arm.inputs, dtype=np.bool_)
        dead = part.weight[0, list(self.arm.elastic)] == 0.0
        return np.concatenate([driven, dead, driven, dead])

    def _start(self, record: int) -> slice:
        first = self.arm.parameters + record * self.arm.motions
        return slice(first, first + self.arm.motions)


def deviations(problem: SimulationError, best: Minimum) -> FloatArray:
    """Return the parameters' standard deviations, (parameters,), at the minimum.

    Residuals of a simulation are far from white. The number of independent samples therefore
    follows from their correlation time.
    """
    residuals = problem.residuals(best.theta)
    count = sum(residual.size for residual in residuals)
    variance = sum(float(np.sum(residual**2)) for residual in residuals) / count
    root = truncated_inverse(best.matrix, smallest=1e-12, equilibrated=True).root
    independent = max(_independence(residuals), _LEAST_INDEPENDENCE / len(residuals[0]))
    return np.asarray(np.sqrt(np.sum(root**2, axis=1) * variance / independent))


def _independence(residuals: Sequence[FloatArray]) -> float:
    """Return the share of independent samples, from the correlation time."""
    times = []
    for residual in residuals:
        for e in residual.T:
            spectrum = np.abs(np.fft.rfft(e, 2 * len(e))) ** 2
            correlation = np.fft.irfft(spectrum)[: len(e)]
            if correlation[0] <= 0.0:
                continue
            correlation = correlation / correlation[0]
            negative = np.flatnonzero(correlation < 0.0)
            last = int(negative[0]) if len(negative) else len(e)
            times.append(1.0 + 2.0 * float(correlation[1:last].sum()))
    return 1.0 / float(np.mean(times)) if times else 1.0


def simulation_error(
    records: Sequence[IoData],
    lives: Sequence[FloatArray],
    drives: Sequence[Drive],
    band_hz: float,
) -> SimulationError:
    """Return the simulation error of an arm over the leading parts of records.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    lives : sequence of ndarray, (samples, outputs)
        Where the sensors of each work, 1, and where they do not, 0.
    drives : sequence of Drive
        The position that each input drives.
    band_hz : float
        Frequency below which the outputs' power lies.

    Raises
    ------
    IdentificationError
        If not every input drives one position.
    """
    positions = _positions(records[0], drives)
    dt_s = records[0].dt_s
    decimation = max(1, int(1.0 / (dt_s * _SAMPLES_PER_PERIOD * max(band_hz, 1e-9))))
    decimation = min(decimation, max(1, min(len(record) for record in records) // 100))
    most = -(-_MOST_SAMPLES * decimation // len(records))
    heads = [record.head(most) for record in records]
    return _of_heads(heads, [live[:most] for live in lives], positions, decimation)


def _positions(record: IoData, drives: Sequence[Drive]) -> tuple[int, ...]:
    outputs = dict(drive_columns(record, drive) for drive in drives)
    missing = [name for i, name in enumerate(record.inputs) if i not in outputs]
    if missing or any(drive.is_speed for drive in drives) or len(outputs) != len(drives):
        raise IdentificationError(
            f"{record.label}: a model with friction needs one position for every input, "
            f"{', '.join(missing) or 'a drive'} has none"
        )
    return tuple(outputs[i] for i in range(len(record.inputs)))


def _of_heads(
    records: Sequence[IoData],
    lives: Sequence[FloatArray],
    positions: tuple[int, ...],
    decimation: int,
) -> SimulationError:
    dt_s = records[0].dt_s * decimation
    cutoff_hz = _ANTI_ALIAS / dt_s if decimation > 1 else np.inf
    outputs = records[0].y.shape[1]
    power = np.sum(
        [np.sum(live * record.y**2, axis=0) for live, record in zip(lives, records, strict=True)],
        axis=0,
    )
    scale = np.sqrt(np.divide(decimation, power, out=np.zeros_like(power), where=power > 0.0))
    peak = np.max([np.abs(record.u).max(axis=0) for record in records], axis=0)
    smooth = [
        (smoothed(record.u, cutoff_hz, record.dt_s), smoothed(record.y, cutoff_hz, record.dt_s))
        for record in records
    ]
    arm = FlexibleArm(positions, _signs(smooth, positions, records[0].dt_s), outputs)
    step = slice(None, None, decimation)
    parts = tuple(
        Part(
            _held(u, decimation),
            _held(np.abs(record.u), decimation),
            y[step],
            live[step] * scale,
        )
        for record, (u, y), live in zip(records, smooth, lives, strict=True)
    )
    return SimulationError(arm, parts, dt_s, COST_OF_ZERO_ERROR / (_ZERO_ERROR * peak))


def _held(u: FloatArray, decimation: int) -> FloatArray:
    """Return the mean input from each kept sample to the next."""
    starts = np.arange(0, len(u), decimation)
    lengths = np.diff(np.append(starts, len(u)))
    return np.asarray(np.add.reduceat(u, starts, axis=0) / lengths[:, np.newaxis])


def _signs(
    smooth: Sequence[tuple[FloatArray, FloatArray]], positions: tuple[int, ...], dt_s: float
) -> tuple[float, ...]:
    power = np.zeros(len(positions))
    for u, y in smooth:
        # Mean power: an input that drives its position supplies more energy than it takes out.
        power += np.sum(u * np.gradient(y[:, list(positions)], dt_s, axis=0), axis=0)
    return tuple(float(sign) for sign in np.where(power < 0.0, -1.0, 1.0))


def descend(
    problem: SimulationError,
    theta: FloatArray,
    *,
    iterations: int,
    free: NDArray[np.int_] | None = None,
) -> Minimum:
    """Return the minimum that is found from a start, among the allowed parameters.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    theta : ndarray, (parameters,)
        Start.
    iterations : int
        Largest number of steps.
    free : ndarray of int, optional
        Places of the parameters that move; all by default.

    Returns
    -------
    Minimum
        All parameters, the cost, and the normal matrix of those that move.
    """
    places = np.arange(len(theta)) if free is None else free

    def whole(part: FloatArray) -> FloatArray:
        joined = theta.copy()
        joined[places] = part
        return joined

    def normal(part: FloatArray) -> Normal:
        cost, gradient, matrix = problem.normal(whole(part))
        return Normal(cost, gradient[places], matrix[np.ix_(places, places)])

    found = minimise(
        theta[places],
        lambda part: problem.cost(whole(part)),
        normal,
        allowed=lambda part: problem.allowed(whole(part))[places],
        iterations=iterations,
    )
    return found._replace(theta=whole(found.theta))


class LevelProfile(NamedTuple):
    """Lowest minimum that was met, and the range of `law_figures` that are equally good."""

    best: Minimum
    lowest: FloatArray
    highest: FloatArray


def profile_levels(
    problem: SimulationError, best: Minimum, others: Sequence[Minimum]
) -> LevelProfile:
    """Return the range of friction laws whose cost is at most 10 % above the smallest.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    best : Minimum
        Its lowest minimum so far. A lower one that the profile meets takes its place.
    others : sequence of Minimum
        Further minima.
    """
    points = [(each.theta, problem.cost(each.theta)) for each in (best, *others)]
    for _ in range(_RESTARTS + 1):
        start, lower = best, best
        for point in _moved(problem, best):
            points.append((point.theta, point.cost))
            if point.cost < _LOWER * lower.cost:
                lower = point
                break
        if lower is start:
            break
        best = descend(problem, lower.theta, iterations=DESCENT)
        points.append((best.theta, best.cost))
    limit = EQUALLY_GOOD * best.cost
    good = [law_figures(problem.arm.laws(theta)) for theta, cost in points if cost <= limit]
    return LevelProfile(best, np.min(good, axis=0), np.max(good, axis=0))


def law_figures(laws: FloatArray) -> FloatArray:
    """Return laws, (inputs, 4), and what holds at standstill: Coulomb level and rise together.

    The two trade with each other, so that a record determines their sum better than either.
    """
    return np.column_stack([laws, laws[:, 0] + laws[:, 1]])


def _moved(problem: SimulationError, best: Minimum) -> Iterator[Minimum]:
    """Yield minima with one parameter fixed, further and further from the best fit."""
    places = np.arange(len(best.theta))
    for place in np.concatenate([places[problem.arm.blocks[name]] for name in _MOVED]):
        free = np.delete(places, place)
        for step in (-_STEP, _STEP):
            theta = best.theta
            for _ in range(_STEPS):
                moved = theta.copy()
                moved[place] += step
                if problem.allowed(moved)[place] != moved[place]:
                    break
                found = descend(problem, moved, iterations=_ITERATIONS, free=free)
                yield found
                if not found.cost <= EQUALLY_GOOD * best.cost:
                    break
                theta = found.theta
