"""Generalised plant of a servo, and its gains by LQG or H-infinity.

LQG, a regulator and a Kalman filter, has the least mean power of outputs and inputs. H-infinity
keeps the largest gain from disturbances and noise to them below a bound (mixed sensitivity, with
the same weights): the central controller with the newest sample (Basar and Bernhard, "H-infinity
optimal control and related minimax design problems", chapter 6, 1995). It expects the worst
disturbance where the plan is left; with an infinite bound it is LQG.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_ident.models.control_library import control_library

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

# Bound over the smallest one: there, the controller would be fast without a reason.
_ABOVE = 1.3
_LARGEST = 1e4
_HALVINGS = 5
_NOTHING, _ROUNDING = 1e-12, 1e-9


class GeneralisedPlant(NamedTuple):
    """Plant with disturbances and noise, and what its outputs and inputs cost.

    Attributes
    ----------
    A, B, C : ndarray
        Plant, then its disturbances: (states, states), (states, inputs), (outputs, states).
    noise : ndarray, (states, states)
        Covariance of the noise of the states.
    sizes : ndarray, (outputs,)
        Noise of the outputs.
    rejection : ndarray, (inputs, disturbances)
        Part of the inputs that each disturbance is.
    cost : ndarray, (plant's states, plant's states)
        Cost of the plant's state.
    effort : ndarray, (inputs, inputs)
        Cost of the inputs with the disturbances.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    noise: FloatArray
    sizes: FloatArray
    rejection: FloatArray
    cost: FloatArray
    effort: FloatArray


class Gains(NamedTuple):
    """Feedback, correction and deviation; see `flexarm_control.servo.regulator.Regulator`."""

    feedback: FloatArray
    correction: FloatArray
    deviation: FloatArray


def lqg_gains(plant: GeneralisedPlant) -> Gains:
    """Return the gains of LQG.

    Raises
    ------
    ValueError, numpy.linalg.LinAlgError
        When there are none.
    """
    library, order = control_library(), len(plant.cost)
    A, B, output_noise = plant.A[:order, :order], plant.B[:order], np.diag(plant.sizes**2)
    gain, *_ = library.dlqr(A, B, plant.cost, plant.effort)
    _, spread, _ = library.dlqe(plant.A, np.eye(len(plant.A)), plant.C, plant.noise, output_noise)
    feedback = np.hstack([np.asarray(gain), plant.rejection])
    return Gains(feedback, _correction(plant, np.asarray(spread)), plant.A)


def hinf_gains(plant: GeneralisedPlant) -> Gains:
    """Return the gains of H-infinity with a bound of 1.3 times the smallest one.

    Raises
    ------
    numpy.linalg.LinAlgError
        When there are none.
    """
    found = within(plant, _ABOVE * smallest_bound(plant))
    if found is None:
        raise np.linalg.LinAlgError("no H-infinity controller")
    return found


def smallest_bound(plant: GeneralisedPlant) -> float:
    """Return the smallest bound that a controller keeps to, 2 % too large at most.

    Raises
    ------
    numpy.linalg.LinAlgError
        When none keeps to any.
    """
    high = 1.0
    while within(plant, high) is None:
        high *= 2.0
        if high > _LARGEST:
            raise np.linalg.LinAlgError("no H-infinity controller")
    low = 0.5 * high
    for _ in range(_HALVINGS):
        middle = (low * high) ** 0.5
        if within(plant, middle) is None:
            low = middle
        else:
            high = middle
    return high


def within(plant: GeneralisedPlant, bound: float) -> Gains | None:
    """Return gains whose largest gain is below a bound; None when no controller has one."""
    order, inputs = len(plant.cost), plant.B.shape[1]
    A, B, square = plant.A[:order, :order], plant.B[:order], bound**2
    # The worst noise of the plant is a second player: a game with one more input.
    pushed = _root(plant.noise[:order, :order])
    both = np.hstack([B, pushed])
    players = scipy.linalg.block_diag(plant.effort, -square * np.eye(pushed.shape[1]))
    # What the past cost, and what the future will cost, by the state with disturbances.
    past = scipy.linalg.block_diag(plant.cost, plant.rejection.T @ plant.effort @ plant.rejection)
    seen = np.hstack([plant.C.T, _root(past)])
    doubts = np.append(plant.sizes**2, np.full(seen.shape[1] - len(plant.C), -square))
    try:
        value = _solved(A, both, plant.cost, players)
        spread = _solved(plant.A.T, seen, plant.noise, np.diag(doubts))
    except (np.linalg.LinAlgError, ValueError):
        return None
    future = np.zeros_like(plant.A)
    future[:order, :order] = value
    correction, one = _correction(plant, spread), np.eye(len(plant.A))
    known = (one - correction @ plant.C) @ spread
    largest = max(map(_radius, (known @ past, known @ future, pushed.T @ value @ pushed)))
    if not largest < square:
        return None
    game = np.linalg.solve(players + both.T @ value @ both, both.T @ value @ A)
    wanted = np.hstack([game[:inputs], plant.rejection])
    feedback = wanted @ np.linalg.inv(one - known @ future / square)
    moved = np.zeros_like(plant.B)
    moved[order:] = plant.rejection.T @ plant.effort
    tilt = np.linalg.solve(one - known @ past / square, one - known @ moved @ feedback / square)
    return Gains(feedback, correction, plant.A @ tilt)


def _correction(plant: GeneralisedPlant, spread: FloatArray) -> FloatArray:
    """Return the gain of the newest sample for a covariance of the predicted state."""
    seen = plant.C @ spread
    return np.asarray(np.linalg.solve(seen @ plant.C.T + np.diag(plant.sizes**2), seen).T)


def _solved(A: FloatArray, B: FloatArray, cost: FloatArray, players: FloatArray) -> FloatArray:
    """Return the positive solution of a Riccati equation; others raise `LinAlgError`."""
    found = np.asarray(scipy.linalg.solve_discrete_are(A, B, cost, players), dtype=np.float64)
    values = np.linalg.eigvalsh(0.5 * (found + found.T))
    if not values.min() > -_ROUNDING * np.abs(values).max():
        raise np.linalg.LinAlgError("no positive solution")
    return found


def _root(matrix: FloatArray) -> FloatArray:
    """Return columns whose products are a positive matrix."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > _NOTHING * values.max(initial=0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def _radius(matrix: FloatArray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))
