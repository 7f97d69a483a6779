"""Equations of motion of a jointed flexible arm as a family of models, with their derivatives.

    M q'' + D q' + K q = E (u - f),    q = (driven positions, elastic coordinates)

M and D are full, symmetric and, by their Cholesky factors, positive, so that every member of the
family is passive in its motion. An elastic coordinate has unit stiffness, which fixes its scale; a
driven position has the small stiffness of its cables, positive or negative. Every other output is
a combination of the elastic coordinates behind a second-order low-pass filter, as strain gauges
have. In the form (2-1) such a model is sampled with its input held (2-2). Its few parameters
generalise to new records, unlike those of a free state-space model with friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Flag, auto
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray


class Rung(Flag):
    """What the friction level depends on beside the direction of motion: the rungs of a ladder.

    Viscous friction is in the damping of every arm.
    """

    COULOMB = 0
    STRIBECK = auto()
    LOAD = auto()


class ArmMatrices(NamedTuple):
    """Discrete member of the family, and its derivatives by the parameters it depends on.

    The parameters are the last axis of the derivatives, and the first of all in the family.
    """

    A: FloatArray
    B: FloatArray
    A_slopes: FloatArray
    B_slopes: FloatArray


@dataclass(frozen=True)
class FlexibleArm:
    """Layout of an arm's parameters and states.

    The states are positions and elastic coordinates, their speeds, and two per filtered output.

    Attributes
    ----------
    positions : tuple of int
        Output that measures the coordinate each input drives, one per input.
    signs : tuple of float
        1.0 where a positive input accelerates its position, -1.0 where it slows it down.
    outputs : int
        Number of all outputs.
    rung : Rung
        What the friction depends on.
    """

    positions: tuple[int, ...]
    signs: tuple[float, ...]
    outputs: int
    rung: Rung = Rung.COULOMB

    law = ("log_level", "log_rise", "log_speed", "log_load")
    """Parameters whose exponentials are the columns of `laws`."""

    @property
    def inputs(self) -> int:
        """Number of inputs, and of driven positions."""
        return len(self.positions)

    @property
    def elastic(self) -> tuple[int, ...]:
        """Outputs that measure the elastic coordinates."""
        return tuple(i for i in range(self.outputs) if i not in self.positions)

    @property
    def states(self) -> int:
        """Number of states."""
        return 2 * self._coordinates + 2 * len(self.elastic)

    @property
    def motions(self) -> int:
        """Number of coordinates and speeds, which tell the initial state."""
        return 2 * self._coordinates

    @property
    def parameters(self) -> int:
        """Number of parameters, without those of initial states."""
        return int(self.blocks["log_load"].stop)

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """Places of each kind of parameter."""
        n, r, e = self._coordinates, self.inputs, len(self.elastic)
        triangle = n * (n + 1) // 2
        sizes = {
            "mass": triangle,
            "damping": triangle,
            "stiffness": r,
            "log_gain": r,
            "gauges": e * e,
            "log_bandwidth": e,
            "log_ratio": e,
            "log_level": r,
            "offset": r,
            "log_rise": r if Rung.STRIBECK in self.rung else 0,
            "log_speed": r if Rung.STRIBECK in self.rung else 0,
            "log_load": r if Rung.LOAD in self.rung else 0,
        }
        ends = np.cumsum(list(sizes.values()))
        return {
            name: slice(int(end) - size, int(end))
            for (name, size), end in zip(sizes.items(), ends, strict=True)
        }

    @cached_property
    def speed(self) -> FloatArray:
        """Rows that take the driven speeds from the state, (inputs, states)."""
        rows = np.zeros((self.inputs, self.states))
        rows[:, self._coordinates : self._coordinates + self.inputs] = np.eye(self.inputs)
        return rows

    @cached_property
    def output_matrix(self) -> FloatArray:
        """Output matrix, (outputs, states)."""
        C = np.zeros((self.outputs, self.states))
        for i, output in enumerate(self.positions):
            C[output, i] = 1.0
        for i, output in enumerate(self.elastic):
            C[output, self.filter_states(i).start] = 1.0
        return C

    def levels(self, theta: FloatArray) -> FloatArray:
        """Return the Coulomb levels, (inputs,)."""
        return self.laws(theta)[:, 0]

    def laws(self, theta: FloatArray) -> FloatArray:
        """Return the friction as `stick_slip.friction_levels` takes it, (inputs, 4)."""
        laws = np.zeros((self.inputs, 4))
        for column, name in enumerate(self.law):
            own = theta[self.blocks[name]]
            if len(own):
                with np.errstate(over="ignore"):
                    laws[:, column] = np.exp(own)
        return laws

    def law_slopes(self, theta: FloatArray) -> FloatArray:
        """Return its derivatives by the parameters, (inputs, 4, parameters)."""
        laws, slopes = self.laws(theta), np.zeros((self.inputs, 4, self.parameters))
        for column, name in enumerate(self.law):
            for i, place in enumerate(range(*self.blocks[name].indices(self.parameters))):
                slopes[i, column, place] = laws[i, column]
        return slopes

    def offsets(self, theta: FloatArray) -> FloatArray:
        """Return the constant parts of the inputs, (inputs,)."""
        return theta[self.blocks["offset"]].copy()

    def filter_states(self, number: int) -> slice:
        """Return the places of the states of a filter, numbered as `elastic`."""
        return slice(self.motions + 2 * number, self.motions + 2 * number + 2)

    def settled(self, theta: FloatArray) -> FloatArray:
        """Return the map from coordinates and speeds to settled filters, (2 * filters, motions)."""
        n, r, e = self._coordinates, self.inputs, len(self.elastic)
        gauges = theta[self.blocks["gauges"]].reshape(e, e)
        settled = np.zeros((2 * e, 2 * n))
        settled[::2, r:n] = settled[1::2, n + r :] = gauges
        return settled

    def initial_state(self, theta: FloatArray, motion: FloatArray) -> FloatArray:
        """Return the state, (states,), of given coordinates and speeds, (motions,).

        The filters have settled on them. Free filters that are faster than the sampling would begin
        anywhere, and decay unseen.
        """
        return np.concatenate([motion, self.settled(theta) @ motion])

    def initial_state_slopes(self, theta: FloatArray, motion: FloatArray) -> FloatArray:
        """Return its derivatives by parameters and motion, (states, parameters + motions)."""
        n, r, e = self._coordinates, self.inputs, len(self.elastic)
        slopes = np.zeros((self.states, self.parameters + self.motions))
        slopes[: 2 * n, self.parameters :] = np.eye(2 * n)
        slopes[2 * n :, self.parameters :] = self.settled(theta)
        for i in range(e):
            own = slice(
                self.blocks["gauges"].start + i * e, self.blocks["gauges"].start + i * e + e
            )
            slopes[2 * n + 2 * i, own] = motion[r:n]
            slopes[2 * n + 2 * i + 1, own] = motion[n + r :]
        return slopes

    def discrete(self, theta: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Return A and B for an input that is held over the sampling period `dt_s` (2-2)."""
        A, B, _, _ = self._continuous(theta)
        step = scipy.linalg.expm(self._joined(A, B) * dt_s)
        return self._parted(step)

    def discrete_with_derivatives(self, theta: FloatArray, dt_s: float) -> ArmMatrices:
        """Return A and B as `discrete` does, and their derivatives."""
        A, B, d_A, d_B = self._continuous(theta)
        joined = self._joined(A, B) * dt_s
        first = self.blocks["log_ratio"].stop
        d_A_step, d_B_step = np.zeros((*A.shape, first)), np.zeros((*B.shape, first))
        for p in range(first):
            change = self._joined(d_A[p], d_B[p]) * dt_s
            change_step = scipy.linalg.expm_frechet(joined, change, compute_expm=False)
            parted = self._parted(np.asarray(change_step, dtype=np.float64))
            d_A_step[..., p], d_B_step[..., p] = parted
        return ArmMatrices(*self._parted(scipy.linalg.expm(joined)), d_A_step, d_B_step)

    @property
    def _coordinates(self) -> int:
        return self.inputs + len(self.elastic)

    def _continuous(
        self, theta: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        n, r = self._coordinates, self.inputs
        lower = np.tril_indices(n)
        mass_root, damping_root = np.zeros((n, n)), np.zeros((n, n))
        mass_root[lower] = theta[self.blocks["mass"]]
        damping_root[lower] = theta[self.blocks["damping"]]
        flexibility = np.linalg.inv(mass_root @ mass_root.T)
        damping = damping_root @ damping_root.T
        stiffness = np.diag(np.concatenate([theta[self.blocks["stiffness"]], np.ones(n - r)]))
        force = np.zeros((n, r))
        force[:r] = np.diag(np.asarray(self.signs) * np.exp(theta[self.blocks["log_gain"]]))
        A, B = np.zeros((self.states, self.states)), np.zeros((self.states, r))
        d_A = np.zeros((self.parameters, *A.shape))
        d_B = np.zeros((self.parameters, *B.shape))
        moving = slice(n, 2 * n)
        A[:n, moving] = np.eye(n)
        A[moving, :n], A[moving, moving] = -flexibility @ stiffness, -flexibility @ damping
        B[moving] = flexibility @ force
        for p, (i, j) in enumerate(np.transpose(lower)):
            change = np.zeros((n, n))
            change[i] = mass_root[:, j]
            change = -flexibility @ (change + change.T) @ flexibility
            at = self.blocks["mass"].start + p
            d_A[at, moving, :n], d_A[at, moving, moving] = -change @ stiffness, -change @ damping
            d_B[at, moving] = change @ force
            change = np.zeros((n, n))
            change[i] = damping_root[:, j]
            at = self.blocks["damping"].start + p
            d_A[at, moving, moving] = -flexibility @ (change + change.T)
        for k in range(r):
            d_A[self.blocks["stiffness"].start + k, moving, k] = -flexibility[:, k]
            d_B[self.blocks["log_gain"].start + k, moving, k] = flexibility @ force[:, k]
        self._add_gauges(theta, A, d_A)
        return A, B, d_A, d_B

    def _add_gauges(self, theta: FloatArray, A: FloatArray, d_A: FloatArray) -> None:
        """Add the low-pass filters ``z'' + 2 ratio w z' + w^2 z = w^2 (gauges q)``."""
        n, r, e = self._coordinates, self.inputs, len(self.elastic)
        gauges = theta[self.blocks["gauges"]].reshape(e, e)
        bandwidth = np.exp(theta[self.blocks["log_bandwidth"]])
        ratio = np.exp(theta[self.blocks["log_ratio"]])
        for i in range(e):
            low, high = 2 * n + 2 * i, 2 * n + 2 * i + 1
            A[low, high] = 1.0
            A[high, low], A[high, high] = -(bandwidth[i] ** 2), -2.0 * ratio[i] * bandwidth[i]
            A[high, r:n] = bandwidth[i] ** 2 * gauges[i]
            for j in range(e):
                d_A[self.blocks["gauges"].start + i * e + j, high, r + j] = bandwidth[i] ** 2
            wider = d_A[self.blocks["log_bandwidth"].start + i, high]
            wider[:] = 2.0 * A[high]
            wider[high] = A[high, high]
            d_A[self.blocks["log_ratio"].start + i, high, high] = A[high, high]

    def _joined(self, A: FloatArray, B: FloatArray) -> FloatArray:
        joined = np.zeros((self.states + self.inputs,) * 2)
        joined[: self.states, : self.states], joined[: self.states, self.states :] = A, B
        return joined

    def _parted(self, joined: FloatArray) -> tuple[FloatArray, FloatArray]:
        upper = joined[: self.states]
        return (
            np.ascontiguousarray(upper[:, : self.states]),
            np.ascontiguousarray(upper[:, self.states :]),
        )
