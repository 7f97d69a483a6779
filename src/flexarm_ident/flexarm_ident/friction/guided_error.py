"""Prediction error of a linear model with dry friction at its joints, over its parameters.

They are the modes, with a position and its speed for the rigid motion of each joint, the matrices B
and C, the initial state, and the friction: levels of Coulomb, how the friction yields below them,
offsets of the inputs, and the map to the joints' speeds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.fitting.levenberg_marquardt import Minimum, Normal
from flexarm_ident.fitting.modal_parameters import ModalParameters
from flexarm_ident.friction.layout import drive_columns
from flexarm_ident.friction.levels import SIGNIFICANT
from flexarm_ident.models.state_space import INTEGRATOR_RADIUS, NEAR_ONE
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.records.iodata import IoData

# Steps of a search, and the decrease that ends it: of a guided one, whose end is the next one's
# start, and of a free one.
_GUIDED, _FREE = (20, 0.02), (7, 2e-4)
# The weights of the outputs follow what is missed of them so often, or until they hardly change.
_WEIGHTINGS, _SETTLED = 6, 0.01
# Rows in which a guided prediction settles.
_SETTLING = 50
_CHUNK = 1024
# A start: friction that takes half of the speed in a sample, and nearly all of the rest.
_REST, _GIVE = 0.5, 0.05
_LARGEST_REST, _LARGEST_GIVE = 0.995, 0.5
# Part of the start's level that a search keeps at least, since no friction has no slope.
_LEAST = 0.02
# A guided model may grow.
_GROWTH = 1.003


class GuidedError(ModalParameters):
    """Prediction error over modal parameters, initial state and friction.

    The last states are the rigid motions of the joints, with a stiffness and a damping in the
    places of A. Behind the matrices and the initial state stand levels, rests, gives and offsets,
    (4, inputs), and the map to the speeds, (inputs, states).

    Parameters
    ----------
    model : control.StateSpace
        Discrete start with a basis of eigenvectors, without feedthrough.
    record : IoData
        Record without holes.
    levels : ndarray, (inputs,)
        Levels of the start, in units of the inputs.
    drives : sequence of Drive
        An output that measures the speed of the joint of each input.

    Attributes
    ----------
    weight : ndarray, (outputs,)
        Weights of the errors; 1 over the noise that the gain expects.
    gain : ndarray, (states, outputs)
        Gain of `guide`, zero for the free simulation.
    """

    def __init__(
        self, model: control.StateSpace, record: IoData, levels: FloatArray, drives: Sequence[Drive]
    ) -> None:
        super().__init__(model)
        self.record, self.weight = record, np.ones(self.m)
        self.gain = np.zeros((self.n, self.m))
        self._integrators: list[int] = []
        self._rigid = self._take_rigid_motions(len(drives))
        self._pair = np.arange(self.n)
        self._is_rigid = self._pair >= self.n - 2 * len(self._rigid)
        for group in self.groups:
            if len(group) > 1:
                self._pair[list(group)] = group[::-1]
        self._least = _LEAST * levels
        self._size = self.n * (2 + self.r + self.m)
        self._standing: list[int] = []
        self._drives = drives

    def start(self, x0: FloatArray, levels: FloatArray) -> FloatArray:
        """Return the parameters of the start."""
        theta = self.pack([x0])
        A, _, C, _ = self.split(theta)
        rates = np.zeros((self.n, self.n))
        for group in self.groups:
            at = np.ix_(group, group)
            block = A[at] if len(group) > 1 else np.maximum(A[at], 1e-3)
            rates[at] = np.real(scipy.linalg.logm(block)) / self.record.dt_s
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
        A, B, C, ends = super().split(theta[: self._size])
        for place, speed in self._rigid:
            A[place, [place, speed]] = 1.0
            A[speed, [place, speed]] = -theta[place], theta[speed]
        return A, B, C, ends

    def pack(self, ends: Sequence[FloatArray]) -> FloatArray:
        """Return the parameters of the start with an initial state."""
        theta = super().pack(ends)
        A = np.linalg.solve(self._basis, self._start.A @ self._basis)
        for place, speed in self._rigid:
            theta[[place, speed]] = -A[speed, place], A[speed, speed]
        return theta

    def _take_rigid_motions(self, joints: int) -> list[tuple[int, int]]:
        """Make the slowest two states of each joint a position and its speed, the last states.

        The next position is the sum of both, and a stiffness and a damping give the next speed.
        Such a pair has any two eigenvalues, also those of a free joint with little viscous
        friction, whose eigenvectors are nearly parallel.
        """
        A, basis = self._start.A, self._basis
        # A pair has one row a + bi of its eigenvalue, a single one its only entry.
        moved = np.linalg.solve(basis, A @ basis) - np.eye(self.n)
        order = sorted(self.groups, key=lambda group: np.linalg.norm(moved[group[0], group]))
        slow: list[tuple[int, ...]] = []
        while order and len(slow) < joints:
            group = order.pop(0)
            if len(group) == 1:
                singles = [each for each in order if len(each) == 1][: 2 * (joints - len(slow)) - 1]
                if not singles:
                    continue
                # Not with the next one: of two joints that are free, both positions stay.
                order.remove(singles[-1])
                group += singles[-1]
            slow.append(group)
        others = [group for group in self.groups if not set(group) & set(np.ravel(slow))]
        columns = [basis[:, group] for group in others]
        for motion in slow:
            span = np.linalg.qr(basis[:, motion])[0]
            turn = span.T @ A @ span
            left = turn - (np.trace(turn) - 1.0) * np.eye(2)
            ways = [np.column_stack([left[:, at], np.eye(2)[:, at]]) for at in range(2)]
            columns.append(span @ max(ways, key=lambda way: abs(np.linalg.det(way))))
        self._basis = np.column_stack(columns)
        ends = np.cumsum([0, *map(len, others), *map(len, slow)])
        self.groups = [tuple(range(*ends[at : at + 2])) for at in range(len(ends) - 1)]
        return [(group[0], group[1]) for group in self.groups[len(others) :]]

    def friction(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return levels, rests, gives and offsets, (4, inputs), and speeds, (inputs, states)."""
        own = theta[self._size :]
        return own[: 4 * self.r].reshape(4, self.r), own[4 * self.r :].reshape(self.r, self.n)

    def integrate(self, theta: FloatArray) -> FloatArray:
        """Return parameters whose eigenvalues next to 1 are 1 and stay there."""
        changed = theta.copy()
        single = [group[0] for group in self.groups if len(group) == 1]
        single = [at for at in single if abs(theta[at] - 1.0) < NEAR_ONE]
        changed[single] = INTEGRATOR_RADIUS
        free = [
            place for place, speed in self._rigid if theta[place] < NEAR_ONE * (1.0 - theta[speed])
        ]
        changed[free] = 0.0
        self._integrators = single + free
        return changed

    def loosen(self, theta: FloatArray) -> FloatArray:
        """Return parameters by which nothing draws a joint back."""
        changed = theta.copy()
        changed[[place for place, _ in self._rigid]] = 0.0
        return changed

    def stand(self, theta: FloatArray) -> FloatArray:
        """Return parameters by which a joint at rest has no speed, and stays so.

        The way to them is easier with a map that may take a part of the position.
        """
        marked = np.zeros_like(theta)
        _, speed = self.friction(marked)
        speed[:, [place for place, _ in self._rigid]] = 1.0
        self._standing = np.flatnonzero(marked).tolist()
        return np.where(marked, 0.0, theta)

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

    def guided_minimum(self, theta: FloatArray, part: float) -> Minimum:
        """Return the minimum that is found with the gain of `guide`, of infinite cost for none."""
        try:
            self.guide(theta, part)
        except (np.linalg.LinAlgError, ValueError):
            return Minimum(theta, np.inf, np.eye(len(theta)))
        return self._searched(theta, *_GUIDED)

    def free_minimum(self, theta: FloatArray, *, holding: bool = False) -> Minimum:
        """Return the minimum without guidance, each output weighted by what is missed of it.

        That is the likelihood's weight of errors of unknown size, be they noise or what no linear
        model has, such as the moving inertia of a second link. An output that drifts at the start
        weighs so little that it may go on drifting: `holding` begins with the present weights.
        """
        self.guide(theta, 0.0)
        found = Minimum(self.allowed(self.integrate(theta)), np.inf, np.eye(len(theta)))
        if holding:
            found = self._searched(found.theta, *_FREE)
        for number in range(_WEIGHTINGS):
            former = self.weight
            with np.errstate(over="ignore", invalid="ignore"):
                self.weight = 1.0 / np.sqrt(np.mean(self.errors(found.theta) ** 2, axis=0))
            if not np.isfinite(self.weight).all() or not self.weight.all():
                break
            if number and np.allclose(self.weight, former, rtol=_SETTLED):
                break
            found = self._searched(found.theta, *_FREE)
        return found

    def _searched(self, theta: FloatArray, iterations: int, tolerance: float) -> Minimum:
        return self.minimised(theta, iterations=iterations, tolerance=tolerance)

    def misfit(self, theta: FloatArray) -> float:
        """Return the sum of the logarithms of what the free simulation misses of each output."""
        self.guide(theta, 0.0)
        with np.errstate(over="ignore", invalid="ignore"):
            missed = np.sum(np.log(np.mean(self.errors(theta) ** 2, axis=0)))
        return float(missed) if np.isfinite(missed) else np.inf

    def allowed(self, theta: FloatArray) -> FloatArray:
        """Return parameters within their bounds, the others unchanged."""
        found = super().allowed(theta)
        largest = self._largest
        for place, speed in self._rigid:
            stiffness, kept = theta[place], min(theta[speed], largest)
            least = (largest - 1.0) * (kept - largest)
            found[[place, speed]] = min(max(stiffness, least), largest**2 - kept), kept
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
        held = self._integrators + self._standing
        total[held] = total[:, held] = 0.0
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
                *(A, B, C, self._pair, self._is_rigid, self.gain, speed, law[:3]),
                *(u[rows], np.ascontiguousarray(self.record.y[rows]), now, slopes),
            )
