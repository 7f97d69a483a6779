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
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray

_COMPLEX_STEP = 1e-30


class FrictionModel(Flag):
    """What the friction level depends on beside the direction of motion.

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
    friction_model : FrictionModel
        What the friction depends on.
    """

    positions: tuple[int, ...]
    signs: tuple[float, ...]
    outputs: int
    friction_model: FrictionModel = FrictionModel.COULOMB

    law = ("log_level", "log_rise", "log_speed", "log_load")
    """Parameters whose exponentials are the columns of `laws`."""

    @property
    def inputs(self) -> int:
        """Number of inputs, and of driven positions."""
        return len(self.positions)

    @cached_property
    def elastic(self) -> tuple[int, ...]:
        """Outputs that measure the elastic coordinates."""
        return tuple(i for i in range(self.outputs) if i not in self.positions)

    @cached_property
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
            "log_rise": r if FrictionModel.STRIBECK in self.friction_model else 0,
            "log_speed": r if FrictionModel.STRIBECK in self.friction_model else 0,
            "log_load": r if FrictionModel.LOAD in self.friction_model else 0,
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
    def measured(self) -> NDArray[np.intp]:
        """State that each output measures, (outputs,)."""
        places = np.empty(self.outputs, dtype=np.intp)
        places[list(self.positions)] = np.arange(self.inputs)
        places[list(self.elastic)] = np.arange(self.motions, self.states, 2)
        return places

    @cached_property
    def output_matrix(self) -> FloatArray:
        """Output matrix, (outputs, states)."""
        return np.asarray(np.eye(self.states)[self.measured])

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
        step = scipy.linalg.expm(self._continuous(theta) * dt_s)
        return self._parted(np.asarray(step, dtype=np.float64))

    def discrete_with_derivatives(self, theta: FloatArray, dt_s: float) -> ArmMatrices:
        """Return A and B as `discrete` does, and their derivatives by complex steps.

        The imaginary part of a function of ``theta + i h`` is h times its derivative, without a
        difference that would lose digits. Al-Mohy, Higham, "The complex step approximation to the
        Frechet derivative of a matrix function", Numerical Algorithms 53 (2010).
        """
        own = theta[: self.parameters]
        moved = own + 1j * _COMPLEX_STEP * np.eye(self.blocks["log_ratio"].stop, len(own))
        steps = scipy.linalg.expm(self._continuous(moved) * dt_s).imag / _COMPLEX_STEP
        slopes = self._parted(np.moveaxis(steps, 0, -1))
        return ArmMatrices(*self.discrete(theta, dt_s), *slopes)

    @cached_property
    def _coordinates(self) -> int:
        return self.inputs + len(self.elastic)

    def _continuous(self, theta: NDArray[Any]) -> NDArray[Any]:
        """Return A and B side by side, above zeros, of real or complex parameters.

        The parameters are the last axis, (..., parameters), and the matrices are the last two.
        """
        n, r = self._coordinates, self.inputs
        lead, size = theta.shape[:-1], self.states + self.inputs
        roots = np.zeros((2, *lead, n, n), dtype=theta.dtype)
        lower = np.tril_indices(n)
        for root, name in zip(roots, ("mass", "damping"), strict=True):
            root[(..., *lower)] = theta[..., self.blocks[name]]
        mass, damping = roots @ np.swapaxes(roots, -1, -2)
        flexibility = np.linalg.inv(mass)
        stiffness = np.ones((*lead, 1, n), dtype=theta.dtype)
        stiffness[..., 0, :r] = theta[..., self.blocks["stiffness"]]
        force = np.asarray(self.signs) * np.exp(theta[..., self.blocks["log_gain"]])
        joined = np.zeros((*lead, size, size), dtype=theta.dtype)
        moving = slice(n, 2 * n)
        joined[..., :n, moving] = np.eye(n)
        joined[..., moving, :n] = -flexibility * stiffness
        joined[..., moving, moving] = -flexibility @ damping
        joined[..., moving, self.states :] = flexibility[..., :r] * force[..., np.newaxis, :]
        self._add_gauges(theta, joined)
        return joined

    def _add_gauges(self, theta: NDArray[Any], joined: NDArray[Any]) -> None:
        """Add the low-pass filters ``z'' + 2 ratio w z' + w^2 z = w^2 (gauges q)``."""
        n, e = self._coordinates, len(self.elastic)
        gauges = theta[..., self.blocks["gauges"]].reshape(*theta.shape[:-1], e, e)
        bandwidth = np.exp(theta[..., self.blocks["log_bandwidth"]])
        ratio = np.exp(theta[..., self.blocks["log_ratio"]])
        low = np.arange(self.motions, self.states, 2)
        high, square = low + 1, bandwidth**2
        joined[..., low, high] = 1.0
        joined[..., high, low], joined[..., high, high] = -square, -2.0 * ratio * bandwidth
        deflections = np.arange(self.inputs, n)
        joined[..., high[:, np.newaxis], deflections] = square[..., np.newaxis] * gauges

    def _parted(self, joined: FloatArray) -> tuple[FloatArray, FloatArray]:
        upper = joined[: self.states]
        return (
            np.ascontiguousarray(upper[:, : self.states]),
            np.ascontiguousarray(upper[:, self.states :]),
        )
