"""Simulation error of a flexible arm with dry friction, and its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Normal
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.arm.equations import FlexibleArm
    from flexarm_ident.fitting.levenberg_marquardt import Minimum

_LEAST_INDEPENDENCE = 0.05
# Part of the load from which friction holds a joint that its load drives.
_SELF_LOCKING = 0.5
# Part of the usual speed over which a rise fades at least.
_LEAST_FADING = 0.01


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
